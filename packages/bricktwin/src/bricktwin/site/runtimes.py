"""Runtimes of a site, which come from npm: Python, physics, the hub's compiler, the editor; and the
archives of modules that Python imports."""

import contextlib
import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from brickhub.files import TEMPORARY_PREFIX, user_cache
from bricktwin.site import bundles, compiled, packages
from bricktwin.site.houses import houses
from bricktwin.site.storing import pack, write_json

EDITOR = Path(__file__).parent / "editor_entry.js"
"""Our part of the editor, which is bundled with the rest of it."""


def put_runtimes(site: Path) -> None:
    """Put what comes from npm, and our houses, into the site; it is made once, and kept in the
    user's cache. Raises SiteError."""
    own = houses()

    def make_archives(work: Path, made: Path) -> None:
        modules = work / "node_modules"
        compiled.write_archives(modules / "pyodide", own, work, made)

    sources = [Path(str(module.__file__)) for module in (bundles, compiled, packages)]
    content = [path.read_bytes() for path in (EDITOR, compiled.SCRIPT, Path(__file__), *sources)]
    _put(site, content, _make_runtimes)
    _put(site, [own, *content], make_archives)


def _put(
    site: Path,
    content: list[bytes],
    make: Callable[[Path, Path], None],
) -> None:
    """Copy into the site what ``make`` makes of packages in one folder into another one, which is
    kept by the content that it is made of."""
    digest = hashlib.sha256(b"".join(content)).hexdigest()
    kept = user_cache() / "site" / digest[:16]
    if not kept.is_dir():
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept.parent, prefix=TEMPORARY_PREFIX) as folder:
            work = Path(folder)
            packages.unpack_packages(work)
            fresh = work / "made"
            make(work, fresh)
            # Another process may have made the same meanwhile.
            with contextlib.suppress(OSError):
                fresh.rename(kept)
    shutil.copytree(kept, site, dirs_exist_ok=True)


def _make_runtimes(work: Path, made: Path) -> None:
    modules = work / "node_modules"
    python = made / "pyodide"
    python.mkdir(parents=True)
    shutil.copy(modules / "pyodide" / "pyodide.mjs", python)
    pack(modules / "pyodide" / "pyodide.asm.mjs", python)
    lock = json.loads((modules / "pyodide" / "pyodide-lock.json").read_text(encoding="utf-8"))
    # It lists packages on a server of Pyodide's: there are none here.
    write_json(python / "pyodide-lock.json", {**lock, "packages": {}})
    pack(modules / "pyodide" / "pyodide.asm.wasm", python)
    physics = modules / "@mujoco" / "mujoco"
    pack(physics / "mujoco.js", made)
    pack(physics / "mujoco.wasm", made)
    compiler = modules / "@pybricks" / "mpy-cross-v6" / "build" / "mpy-cross-v6.wasm"
    pack(compiler, made)
    bundles.bundle(work, EDITOR, made)
