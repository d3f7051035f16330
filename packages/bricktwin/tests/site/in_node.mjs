// A tab's worker without a tab: Pyodide with our houses, MuJoCo and the hub's compiler, in Node.js.
//
//     node in_node.mjs MODULES FOLDER... SCRIPT [ARGUMENT...]
//
// MODULES: node_modules with Pyodide and MuJoCo; FOLDER: sources on Python's path, before `--`; SCRIPT: a Python file, which finds
// `start_engine` (makes an engine of a robot's file, JSON text), `compile_in_tab`, `cpu_seconds` and `ARGUMENTS`.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const rest = process.argv.slice(2), end = rest.indexOf("--");
const [modules, ...folders] = rest.slice(0, end).map((path) => resolve(path));
const [script, ...given] = rest.slice(end + 1);
const load = (path) => import(pathToFileURL(path).href);
const { loadPyodide } = await load(join(modules, "pyodide/pyodide.mjs"));
const { default: loadMujoco } = await load(join(modules, "@mujoco/mujoco/mujoco.js"));
const here = dirname(fileURLToPath(import.meta.url));
const worker = join(here, "../../src/bricktwin/site/worker");
const { Engine } = await load(join(worker, "engine.js"));
const { compile } = await load(join(worker, "compiler.js"));
const MpyCross = createRequire(import.meta.url)(join(modules, "@pybricks/mpy-cross-v6/build/mpy-cross-v6.js"));

const [python, mujoco] = await Promise.all([loadPyodide({ indexURL: join(modules, "pyodide") }), loadMujoco()]);
folders.forEach((folder, number) => {
  python.mountNodeFS(`/folder_${number}`, folder);
  python.runPython(`import sys; sys.path.append("/folder_${number}")`);
});
python.setStdout({ batched: (line) => console.log(line) });

const compiler = new WebAssembly.Module(readFileSync(join(modules, "@pybricks/mpy-cross-v6/build/mpy-cross-v6.wasm")));
python.globals.set("start_engine", (file) => new Engine(mujoco, JSON.parse(file)));
python.globals.set("compile_in_tab", (name, source, options) => python.toPy(compile(MpyCross, compiler, name, source, options.toJs())));
const cpuSeconds = () => (({ user, system }) => (user + system) / 1e6)(process.cpuUsage());
python.globals.set("cpu_seconds", cpuSeconds);
python.globals.set("ARGUMENTS", python.toPy(given));
try {
  python.runPython(readFileSync(script, "utf-8"), { filename: script });
} catch (error) {
  console.error(String(error));
  process.exitCode = 1;
}
