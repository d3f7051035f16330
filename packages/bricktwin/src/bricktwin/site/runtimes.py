"""Runtimes of a site, which come from npm: Python, physics, the hub's compiler, the editor."""

import contextlib
import hashlib
import json
import re
import shutil
import tempfile
import zipfile
from pathlib import Path

from brickhub.files import TEMPORARY_PREFIX, user_cache
from bricktwin.site import bundles, packages
from bricktwin.site.storing import pack, undated, write_json

EDITOR = Path(__file__).parent / "editor_entry.js"
"""Our part of the editor, which is bundled with the rest of it."""
_NEVER_ASKED = (
    "(unittest|xmlrpc|wsgiref|pydoc|pydoc_data|ensurepip|venv|idlelib|tkinter|turtle|sqlite3|dbm|"
    "curses|multiprocessing|_pyrepl|mailbox|imaplib|smtplib|poplib|ftplib|doctest|pdb|bdb|"
    "pickletools|plistlib|optparse|_pydatetime|_pydecimal|cProfile|profile|pstats|trace|zipapp|"
    "webbrowser|netrc|modulefinder|xml|zoneinfo|statistics)(/|[.]py)"
)
"""Modules of Python that a site leaves out: interfaces to what no tab has, tools of developers."""


def put_runtimes(site: Path) -> None:
    """Put what comes from npm into the site; it is made once, and kept in the user's cache. Raises
    SiteError."""
    made = user_cache() / "site" / _runtimes_key()
    if not made.is_dir():
        made.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=made.parent, prefix=TEMPORARY_PREFIX) as folder:
            work = Path(folder)
            packages.unpack_packages(work)
            fresh = work / "made"
            _make_runtimes(work, fresh)
            # Another process may have made the same meanwhile.
            with contextlib.suppress(OSError):
                fresh.rename(made)
    shutil.copytree(made, site, dirs_exist_ok=True)


def _runtimes_key() -> str:
    """Name of the runtimes by all that they are made of."""
    digest = hashlib.sha256()
    modules = [Path(str(module.__file__)) for module in (bundles, packages)]
    for source in (EDITOR, Path(__file__), *modules):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _make_runtimes(work: Path, made: Path) -> None:
    modules = work / "node_modules"
    python = made / "pyodide"
    python.mkdir(parents=True)
    for name in ("pyodide.mjs", "pyodide.asm.mjs"):
        shutil.copy(modules / "pyodide" / name, python / name)
    lock = json.loads((modules / "pyodide" / "pyodide-lock.json").read_text(encoding="utf-8"))
    # It lists packages on a server of Pyodide's: there are none here.
    write_json(python / "pyodide-lock.json", {**lock, "packages": {}})
    pack(modules / "pyodide" / "pyodide.asm.wasm", python)
    pack(_stored(modules / "pyodide" / "python_stdlib.zip", work), python)
    physics = modules / "@mujoco" / "mujoco"
    shutil.copy(physics / "mujoco.js", made / "mujoco.js")
    pack(physics / "mujoco.wasm", made)
    compiler = modules / "@pybricks" / "mpy-cross-v6" / "build" / "mpy-cross-v6.wasm"
    pack(compiler, made)
    bundles.bundle(work, EDITOR, made)


def _stored(archive: Path, folder: Path) -> Path:
    """The same archive without compression, as a whole it becomes smaller; and without modules of
    which nothing in a tab is known to ask."""
    stored = folder / archive.name
    with zipfile.ZipFile(archive) as packed, zipfile.ZipFile(stored, "w") as plain:
        for name in packed.namelist():
            if re.match(_NEVER_ASKED, name):
                continue
            plain.writestr(undated(name), packed.read(name))
    return stored
