"""JavaScript of npm's packages, made single files by the bundler esbuild."""

import subprocess
from pathlib import Path

from bricktwin.site.packages import SiteError, node

_MPY_CROSS = 'export { default } from "@pybricks/mpy-cross-v6/build/mpy-cross-v6.js";\n'
_ESBUILD = "node_modules/esbuild-wasm/bin/esbuild"
# Parts of Node.js that a package names for use there; a browser never asks for them.
_OF_NODE = ("fs", "path")


def bundle(work: Path, editor: Path, target: Path) -> None:
    """Bundle what comes in many files: ``editor.js`` and ``mpy_cross.js``.

    Args:
        work: folder with ``node_modules``.
        editor: module with our part of the editor.
        target: folder of the bundles.

    Raises:
        SiteError: the bundler refuses something.
    """
    (work / "editor.js").write_bytes(editor.read_bytes())
    (work / "mpy_cross.js").write_text(_MPY_CROSS, encoding="utf-8")
    options = ["--bundle", "--minify", "--format=esm", "--platform=browser", "--log-level=error"]
    options += [f"--external:{name}" for name in _OF_NODE]
    # Both at once, as the bundler takes long to start.
    entries = ["editor.js", "mpy_cross.js"]
    done = subprocess.run(  # noqa: S603  our own words only
        [node(), _ESBUILD, *entries, *options, f"--outdir={target.resolve()}"],
        cwd=work,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        said = " ".join(done.stderr.split()) or f"it ended with status {done.returncode}"
        raise SiteError(f"esbuild could not bundle the editor and the compiler: {said}")
