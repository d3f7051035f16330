// Worker of one hub: Python, the houses of this project, the hub's compiler and the robot's physics. It runs one program at a
// time, which blocks it: what comes meanwhile comes through the mailbox.

import { loadPyodide } from "./pyodide/pyodide.mjs";
import MpyCross from "./mpy_cross.js";
import { Mailbox } from "./mailbox.js";
import { fetchPacked } from "./packed.js";

const HOUSES = "/houses", PATIENCE_MS = 50;
const say = (kind, values = {}, transfer = []) => postMessage({ kind, ...values }, transfer);
let runInTab = null, mailbox = null;

// What Python calls; see tab/page.py.
const page = {
  post(events, frames) {
    const bytes = frames.toJs();
    frames.destroy();
    say("happened", { events, frames: new Float32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4) });
  },
  take: () => (mailbox ? mailbox.take() : ""),
  may_go_on: (ms) => !mailbox || mailbox.mayGoOn(ms, PATIENCE_MS),
};

async function start({ memory, interrupt }) {
  if (memory) mailbox = new Mailbox(memory);
  // Pyodide asks for its parts by name; those that are stored compressed are unpacked here.
  const plainFetch = globalThis.fetch.bind(globalThis);
  globalThis.fetch = (resource, options) => {
    const url = String(resource.url ?? resource);
    return /\.(wasm|zip)$/.test(url) ? fetchPacked(url) : plainFetch(resource, options);
  };
  const here = (name) => new URL(name, import.meta.url).href;
  const [python, houses, compiler] = await Promise.all([
    loadPyodide({ indexURL: here("./pyodide/") }),
    plainFetch(here("houses.zip")).then((response) => response.arrayBuffer()),
    fetchPacked(here("mpy-cross-v6.wasm")).then((response) => response.arrayBuffer()).then(WebAssembly.compile),
  ]);
  if (interrupt) python.setInterruptBuffer(interrupt);
  python.unpackArchive(houses, "zip", { extractDir: HOUSES });
  python.runPython(`import sys; sys.path.insert(0, "${HOUSES}")`);
  python.pyimport("bricktwin.site.tab.mpy_cross").put_in_place((name, source, options) => compile(compiler, name, source, options.toJs(), python));
  runInTab = python.pyimport("bricktwin.site.tab.run").run_in_tab;
  say("ready");
}

// The hub's compiler, which begins anew for each program; at once, as a program may compile while it runs.
function compile(module, name, source, options, python) {
  let result = [1, undefined, "the compiler has ended without a word"];
  MpyCross({
    arguments: [...options, name],
    inputFileContents: source,
    instantiateWasm(imports, receive) {
      const instance = new WebAssembly.Instance(module, imports);
      receive(instance, module);
      return instance.exports;
    },
    callback: (status, mpy, _out, report) => (result = [status, mpy, report.join("\n")]),
  });
  const [status, mpy, report] = result;
  return python.toPy([status, mpy, report]);
}

function run(request) {
  const code = runInTab(JSON.stringify(request), page);
  say("ended", { code });
}

onmessage = async ({ data }) => {
  try {
    if (data.kind === "start") await start(data);
    if (data.kind === "run") run(data.request);
  } catch (error) {
    // Python itself has given up, or a file is missing: this worker is of no use any more.
    say("failed", { text: String(error?.message ?? error), stack: String(error?.stack ?? "") });
  }
};
