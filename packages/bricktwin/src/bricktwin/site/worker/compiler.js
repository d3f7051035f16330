// The hub's compiler, which begins anew for each program; at once, as a program may compile while it runs.

const FLAT = "main.py";

// Status, `.mpy` and report for the name of a program or of a module, and its source. `MpyCross`: Pybricks' package; `module`: its compiled
// WebAssembly.
export function compile(MpyCross, module, name, source, options) {
  let result = [1, undefined, "the compiler has ended without a word"];
  // It has no folders, and looks for its output beside a file that ends with .py; what `eval` compiles has no such name.
  const isFlat = name.endsWith(".py") && !name.includes("/"), words = isFlat ? [name] : ["-s", name, FLAT];
  MpyCross({
    arguments: [...options, ...words],
    inputFileContents: source,
    instantiateWasm(imports, receive) {
      const instance = new WebAssembly.Instance(module, imports);
      receive(instance, module);
      return instance.exports;
    },
    callback: (status, mpy, _out, report) => (result = [status, mpy, report.join("\n")]),
  });
  const [status, mpy, report] = result;
  return [status, mpy, isFlat ? report : report.replaceAll(`File "${FLAT}"`, `File "${name}"`)];
}
