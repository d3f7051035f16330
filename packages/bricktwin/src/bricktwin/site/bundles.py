"""JavaScript of npm's packages, each made one file by the bundler esbuild."""

import subprocess
from pathlib import Path

from bricktwin.site.packages import SiteError, node

_MPY_CROSS = 'export { default } from "@pybricks/mpy-cross-v6/build/mpy-cross-v6.js";\n'
_ESBUILD = "node_modules/esbuild-wasm/bin/esbuild"
# Parts of Node.js that a package names for use there; a browser never asks for them.
_OF_NODE = ("fs", "path")


def bundle(work: Path, entry: Path, target: Path) -> None:
    """Bundle an entry file with what it imports from ``work/node_modules``. Raises SiteError."""
    here = work / entry.name
    here.write_bytes(entry.read_bytes())
    _run_esbuild(work, here, target)


def bundle_compiler(work: Path, target: Path) -> None:
    """Bundle the loader of the hub's compiler, as a module. Raises SiteError."""
    entry = work / "mpy_cross_entry.js"
    entry.write_text(_MPY_CROSS, encoding="utf-8")
    _run_esbuild(work, entry, target)


def _run_esbuild(work: Path, entry: Path, target: Path) -> None:
    options = ["--bundle", "--minify", "--format=esm", "--platform=browser", "--log-level=error"]
    options += [f"--external:{name}" for name in _OF_NODE]
    done = subprocess.run(  # noqa: S603  our own words only
        [node(), _ESBUILD, entry.name, *options, f"--outfile={target.resolve()}"],
        cwd=work,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        said = " ".join(done.stderr.split()) or f"it ended with status {done.returncode}"
        raise SiteError(f"esbuild could not bundle {entry.name}: {said}")
