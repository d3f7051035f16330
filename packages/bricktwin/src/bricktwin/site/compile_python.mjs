// Python of a tab compiles what it imports at its start, so that no visitor's tab has to.
//
//     node compile_python.mjs PYODIDE LIBRARY.zip HOUSES.zip FOLDER
//
// Writes both archives anew into FOLDER: modules that the start imports are compiled, without their sources; the rest stays as it is,
// which is smaller.

import { readFileSync, writeFileSync } from "node:fs";
import { basename, join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [pyodide, library, houses, folder] = process.argv.slice(2);
const { loadPyodide } = await import(pathToFileURL(join(resolve(pyodide), "pyodide.mjs")).href);
const python = await loadPyodide({ indexURL: resolve(pyodide) });
const bytes = readFileSync(houses);
python.unpackArchive(new Uint8Array(bytes).buffer, "zip", { extractDir: "/houses" });
for (const archive of [library, houses]) python.FS.writeFile(`/${basename(archive)}`, readFileSync(archive));
python.runPython(`
import sys
sys.path.insert(0, "/houses")
from bricktwin.site.tab import mpy_cross
mpy_cross.put_in_place(lambda name, source, options: (1, None, ""))
import bricktwin.site.tab.robot_file
import bricktwin.site.tab.run

import ast
import importlib.util
import zipfile
from importlib._bootstrap_external import _code_to_hash_pyc

# Which are read as texts, too.
READ = ("/frozen/", "/onboard/")
files = {getattr(module, "__file__", None) or "" for module in sys.modules.values()}


def without_docstrings(content):
    """Syntax tree in which docstrings, which no tab shows, are a dot: without any, each dataclass would write its own."""
    tree = ast.parse(content)
    for node in ast.walk(tree):
        can_have_one = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if can_have_one and ast.get_docstring(node, clean=False) is not None:
            node.body[0].value.value = "."
    return tree


def compile_archive(name, top):
    with zipfile.ZipFile("/" + name) as sources, zipfile.ZipFile("/compiled_" + name, "w") as compiled:
        for entry in sources.namelist():
            content = sources.read(entry)
            # An entry without a date is the same each time.
            info = zipfile.ZipInfo(entry)
            if f"{top}/{entry}" not in files or any(folder in entry for folder in READ):
                compiled.writestr(info, content)
                continue
            code = compile(without_docstrings(content), entry, "exec", dont_inherit=True)
            # It is not compared with its source, which is not there.
            binary = _code_to_hash_pyc(code, importlib.util.source_hash(content), False)
            info.filename += "c"
            compiled.writestr(info, binary)


compile_archive(${JSON.stringify(basename(library))}, next(path for path in sys.path if path.endswith(".zip")))
compile_archive(${JSON.stringify(basename(houses))}, "/houses")
`);
for (const archive of [library, houses]) writeFileSync(join(folder, basename(archive)), python.FS.readFile(`/compiled_${basename(archive)}`));
