// Worker of one hub: Python, the houses of this project, the hub's compiler and the robot's physics. It runs one program at a
// time, which blocks it: what comes meanwhile comes through the mailbox.

import { loadPyodide } from "./pyodide/pyodide.mjs";
import { compile } from "./compiler.js";
import MpyCross from "./mpy_cross.js";
import { Mailbox } from "./mailbox.js";
import { fetchPacked, importPacked } from "./packed.js";
import { Physics } from "./physics.js";
import { withPicture } from "./picture.js";
import { together } from "./together.js";

const HOUSES = "/houses", PATIENCE_MS = 50, ROW = 8;
const say = (kind, values = {}, transfer = []) => postMessage({ kind, ...values }, transfer);
let python = null, runInTab = null, runInRoom = null, bodyInTab = null, readJson = null, mailbox = null;
let mujoco = null, physics = null; // a promise of MuJoCo, and the physics of a robot that was chosen
let hasKits = false;
let garbage = null; // Python's module gc
let hubMailbox = null, realHub = null; // once a hub is connected
let poses = []; // of the frames since the last post

// What Python calls; see tab/recorder.py.
const page = {
  frame: () => physics && poses.push(physics.poses()),
  post(events, rows) {
    const bytes = rows.toJs();
    rows.destroy();
    const frames = withPoses(new Float32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4));
    say("happened", { events, frames }, [frames.buffer]);
  },
  take: () => (mailbox ? mailbox.take() : ""),
  may_go_on: (ms) => !mailbox || mailbox.mayGoOn(ms, PATIENCE_MS),
};

// Bluetooth and cable are the page's: what Python asks of it, see tab/web_port.py.
const hubPage = {
  ask: (number, operation, characteristic, data) => say("ask", { number, operation, characteristic, data }),
  ask_kit: (number, operation, device, characteristic, data) => say("ask", { number, operation, device, characteristic, data }),
  take: () => hubMailbox.take(),
  wait: (longest_ms) => hubMailbox.wait(longest_ms),
};

async function start({ memory, hubMemory, interrupt, needsPhysics }) {
  if (memory) mailbox = new Mailbox(memory);
  if (hubMemory) hubMailbox = new Mailbox(hubMemory);
  // Pyodide asks for its parts by name; those that are stored compressed are unpacked here.
  const plainFetch = globalThis.fetch.bind(globalThis);
  globalThis.fetch = (resource, options) => {
    const url = String(resource.url ?? resource);
    return /\.(wasm|zip)$/.test(url) ? fetchPacked(url) : plainFetch(resource, options);
  };
  // It is compiled beside Python, by threads of the browser's.
  if (needsPhysics) mujoco = loadMujoco();
  const here = (name) => new URL(name, import.meta.url).href;
  const [pyodide, houses, compiler] = await Promise.all([
    importPacked(here("pyodide/pyodide.asm.mjs")).then((module) => loadPyodide({ indexURL: here("./pyodide/"), createPyodideModule: module.default })),
    fetchPacked(here("houses.zip")).then((response) => response.arrayBuffer()),
    fetchPacked(here("mpy-cross-v6.wasm")).then((response) => response.arrayBuffer()).then(WebAssembly.compile),
  ]);
  python = pyodide;
  if (interrupt) python.setInterruptBuffer(interrupt);
  python.unpackArchive(houses, "zip", { extractDir: HOUSES });
  python.runPython(`import sys; sys.path.insert(0, "${HOUSES}")`);
  python.pyimport("bricktwin.site.tab.mpy_cross").put_in_place((name, source, options) => python.toPy(compile(MpyCross, compiler, name, source, options.toJs())));
  const run = python.pyimport("bricktwin.site.tab.run");
  run.heed_stops_in_runs_only();
  runInTab = run.run_in_tab;
  runInRoom = run.run_in_room;
  bodyInTab = python.pyimport("bricktwin.site.tab.robot_file").body_in_tab;
  readJson = python.pyimport("json").loads;
  garbage = python.pyimport("gc");
  garbage.freeze(); // what is imported stays
  say("ready");
}

// The rows of the hub, each with the poses of its moment.
function withPoses(rows) {
  if (!poses.length) return rows.slice();
  const width = ROW + poses[0].length, frames = new Float32Array(width * poses.length);
  poses.forEach((row, i) => {
    frames.set(rows.subarray(ROW * i, ROW * i + ROW), width * i);
    frames.set(row, width * i + ROW);
  });
  poses = [];
  return frames;
}

// Other hubs of a room, as Python sees them; see tab/room.py. `told`, `heard`: memories of mailboxes.
function othersOf({ told, heard }) {
  const out = told.map((memory) => new Mailbox(memory)), into = heard.map((memory) => new Mailbox(memory));
  return {
    tell: (deeds) => out.forEach((box) => box.tell(deeds)),
    hear(number, longest_ms) {
      into[number].wait(longest_ms);
      return into[number].take();
    },
  };
}

const fetchFile = async (name) => (await fetchPacked(new URL(name, import.meta.url).href)).json();

// One file of robots that share a world, of a file for each of them and for the world.
async function fetchTogether(files) {
  const [world, ...robots] = await Promise.all([files.world, ...files.robots].map(fetchFile));
  const putTogether = python.pyimport("bricktwin.site.tab.robot_file").put_together_text;
  return { robot: JSON.parse(putTogether(JSON.stringify(robots), JSON.stringify(world))), ...together({ robots, world }) };
}

async function run({ robot, picture, boxes, ...request }) {
  physics?.end();
  physics = null;
  let body, file;
  if (robot) {
    const plain = boxes ? await fetchTogether(robot) : await fetchFile(robot);
    file = picture ? withPicture(plain, picture) : plain;
    mujoco ??= loadMujoco();
    physics = new Physics(await mujoco, file);
    if (!boxes) body = bodyInTab(readJson(JSON.stringify(file.robot)), physics.engine);
  }
  if (boxes) {
    const world = file && readJson(JSON.stringify(file.robot));
    say("ended", { code: runInRoom(JSON.stringify(request), page, othersOf(boxes), world, physics?.engine) });
    return;
  }
  if (request.files) await fetchKits(request.files[request.name]);
  const act = request.goal ? python.pyimport("bricktwin.site.tab.teach").teach_in_tab : runInTab;
  const code = act(JSON.stringify(request), page, body);
  body?.destroy();
  // What a program has piled too high to be taken down again is too much in its own run, not in one after it.
  garbage.collect();
  say("ended", { code });
}

// LEGO's package for its kits, for a program that is for them; a site may be without it, and then Python says so.
async function fetchKits(source) {
  if (hasKits || !python.pyimport("bricktwin.site.tab.run").is_for_kits(source)) return;
  const response = await fetchPacked(new URL("kits.zip", import.meta.url).href).catch(() => null);
  if (!response) return;
  python.unpackArchive(await response.arrayBuffer(), "zip", { extractDir: HOUSES });
  hasKits = true;
}

// A program for LEGO's kits, on real devices.
async function runOnKit(request) {
  await fetchKits(request.files[request.name]);
  say("ended", { code: python.pyimport("bricktwin.site.tab.real_kit").run_on_kit(JSON.stringify(request), hubPage, page) });
}

async function obeyHub({ robot, ...request }) {
  const file = request.hub === "teach" ? (await fetchFile(robot)).robot : null;
  realHub ??= python.pyimport("bricktwin.site.tab.real_hub").RealHub(hubPage, page);
  say("ended", { code: realHub.obey(JSON.stringify(request), file && readJson(JSON.stringify(file))) });
}

async function loadMujoco() {
  const { default: load } = await importPacked(new URL("mujoco.js", import.meta.url).href);
  return load({ locateFile: (name) => new URL(name, import.meta.url).href });
}

onmessage = async ({ data }) => {
  try {
    if (data.kind === "start") await start(data);
    if (data.kind === "run") await (data.request.hub === "kit" ? runOnKit : data.request.hub ? obeyHub : run)(data.request);
    if (data.kind === "attend") realHub?.attend();
  } catch (error) {
    // Python itself has given up, or a file is missing: this worker is of no use any more.
    say("failed", { text: String(error?.message ?? error), stack: String(error?.stack ?? "") });
  }
};
