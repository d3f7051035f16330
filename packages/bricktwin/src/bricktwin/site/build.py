"""Folder of the site: pages, scripts, runtimes, the houses of this project, programs and robots."""

import contextlib
import gzip
import hashlib
import io
import json
import re
import shutil
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import brickhub
import bricktwin
from brickhub.files import TEMPORARY_PREFIX, user_cache
from brickhub.robot import Robot
from bricktwin.site.bundles import bundle
from bricktwin.site.names import device_table, pybricks_names
from bricktwin.site.packages import SiteError, unpack_packages
from bricktwin.site.robots import OWN, PACKED, write_robots
from bricktwin.view.script import FOLDER as VIEW
from bricktwin.worlds import WORLDS

_HERE = Path(__file__).parent
STATIC = _HERE / "static"
PROGRAMS = _HERE / "programs"
LIST = "files.json"
"""List of all files of a site with their sizes, by which a site is known."""
_SERVICE_WORKER = "service_worker.js"
_BUILD_MARK = "BUILD-MARK"
_EDITOR = "editor_entry.js"
_FOR_ROBOT = re.compile(r"(?m)^# Robot: ([\w.-]+) ?([\w-]*)$")
_IMPORTED = re.compile(r'from "\./(\w+\.js)"')
_NOT_COPIED = (_EDITOR, _SERVICE_WORKER)
# Modules of the houses that nothing in a tab can use: they need the computer, or are not for it.
_LEFT_OUT = (
    "brickhub/cli",
    "bricktwin/cli",
    "bricktwin/measure",
    "bricktwin/plans",
    "bricktwin/site/programs",
    "bricktwin/site/static",
    "bricktwin/twin/render",
    "bricktwin/view",
)
_NEVER_ASKED = (
    "(unittest|xmlrpc|wsgiref|pydoc|pydoc_data|ensurepip|venv|idlelib|tkinter|turtle|sqlite3|dbm|"
    "curses|multiprocessing|_pyrepl|mailbox|imaplib|smtplib|poplib|ftplib|doctest|pdb|bdb|"
    "pickletools|plistlib|optparse|_pydatetime|_pydecimal|cProfile|profile|pstats|trace|zipapp|"
    "webbrowser|netrc|modulefinder|xml|zoneinfo|statistics)(/|[.]py)"
)
"""Modules of Python that a site leaves out: interfaces to what no tab has, tools of developers."""
_FIXED_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of the files in an archive, so that the same sources make the same site."""


def build_site(
    out: Path,
    robots: Sequence[Robot] = OWN,
    policies: Path | None = None,
    worlds: Sequence[str] = tuple(WORLDS),
) -> list[Path]:
    """Make a site in a folder, which is new, empty, or a site that is replaced.

    Args:
        out: the folder.
        robots: those that can be chosen, the first one at first.
        policies: folder of hub programs, ``NAME.py``, that are offered beside ours.
        worlds: those that can be chosen for robots that drive, beside the open floor.

    Returns:
        All files of the site.

    Raises:
        SiteError: the folder is something else, or what the site is made of cannot be fetched.
        TwinError: a robot has no model.
    """
    check_folder(out)
    with tempfile.TemporaryDirectory(prefix="bricktwin-site-") as folder:
        fresh = Path(folder) / "site"
        fresh.mkdir()
        _copy_pages(fresh)
        _put_runtimes(fresh)
        (fresh / "houses.zip").write_bytes(houses())
        _write_json(fresh / "robots.json", write_robots(fresh, robots, worlds))
        _write_json(fresh / "programs.json", programs(policies))
        _write_json(fresh / "pybricks.json", pybricks_names())
        _write_json(fresh / "devices.json", device_table())
        _finish(fresh)
        _replace(out, fresh)
    return sorted(path for path in out.rglob("*") if path.is_file())


def check_folder(out: Path) -> None:
    """Raise SiteError if a folder has anything but a site."""
    if out.is_file():
        raise SiteError(f"{out} is a file; name a folder for the site")
    is_taken = out.is_dir() and any(out.iterdir())
    if is_taken and not (out / LIST).is_file():
        raise SiteError(f"{out} has other files; name a new folder for the site")


def _copy_pages(site: Path) -> None:
    for path in STATIC.iterdir():
        if path.name not in _NOT_COPIED:
            shutil.copy(path, site / path.name)
    view = site / "view"
    view.mkdir()
    # The drawing is that of the live page.
    for name in _modules("scene3d.js", "frames.js"):
        (view / name).write_bytes((VIEW / name).read_bytes())


def _modules(*names: str) -> set[str]:
    """Files of the view with all that they import."""
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _IMPORTED.findall((VIEW / name).read_text(encoding="utf-8"))
    return found


def _put_runtimes(site: Path) -> None:
    """Put what comes from npm into the site; it is made once, and kept in the user's cache."""
    made = user_cache() / "site" / _runtimes_key()
    if not made.is_dir():
        made.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=made.parent, prefix=TEMPORARY_PREFIX) as folder:
            work = Path(folder)
            unpack_packages(work)
            fresh = work / "made"
            _make_runtimes(work, fresh)
            # Another process may have made the same meanwhile.
            with contextlib.suppress(OSError):
                fresh.rename(made)
    shutil.copytree(made, site, dirs_exist_ok=True)


def _runtimes_key() -> str:
    """Name of the runtimes by all that they are made of."""
    digest = hashlib.sha256()
    for source in (STATIC / _EDITOR, Path(__file__), _HERE / "bundles.py", _HERE / "packages.py"):
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
    _write_json(python / "pyodide-lock.json", {**lock, "packages": {}})
    _pack(modules / "pyodide" / "pyodide.asm.wasm", python)
    _pack(_stored(modules / "pyodide" / "python_stdlib.zip", work), python)
    physics = modules / "@mujoco" / "mujoco"
    shutil.copy(physics / "mujoco.js", made / "mujoco.js")
    _pack(physics / "mujoco.wasm", made)
    compiler = modules / "@pybricks" / "mpy-cross-v6" / "build" / "mpy-cross-v6.wasm"
    _pack(compiler, made)
    bundle(work, STATIC / _EDITOR, made)


def _stored(archive: Path, folder: Path) -> Path:
    """The same archive without compression, as a whole it becomes smaller; and without modules of
    which nothing in a tab is known to ask."""
    stored = folder / archive.name
    with zipfile.ZipFile(archive) as packed, zipfile.ZipFile(stored, "w") as plain:
        for name in packed.namelist():
            if re.match(_NEVER_ASKED, name):
                continue
            plain.writestr(zipfile.ZipInfo(name, _FIXED_DATE), packed.read(name))
    return stored


def _pack(source: Path, folder: Path) -> None:
    """Store a file compressed, without a date."""
    content = gzip.compress(source.read_bytes(), 9, mtime=0)
    (folder / (source.name + PACKED)).write_bytes(content)


def houses() -> bytes:
    """Archive of the sources of brickhub and bricktwin, as they are installed here."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in _sources():
            archive.writestr(zipfile.ZipInfo(name, _FIXED_DATE), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _sources() -> Iterator[tuple[str, bytes]]:
    """Name and content of each source."""
    for house in (brickhub, bricktwin):
        top = Path(str(house.__file__)).parent
        for path in sorted(top.rglob("*.py")):
            name = path.relative_to(top.parent).as_posix()
            if not name.startswith(_LEFT_OUT):
                yield name, path.read_bytes()


def programs(policies: Path | None) -> list[dict[str, str]]:
    """Programs that the page offers: title, file name, source, the robot and world it is for.

    The first line of each is a comment with its title; a second one, ``# Robot: ROBOT WORLD``,
    names the robot and the world, else it is for the bench.
    """
    found = list(_described(sorted(PROGRAMS.glob("*.py"))))
    if policies is not None:
        files = sorted(policies.glob("*.py"))
        if not files:
            raise SiteError(f"{policies} has no programs; put exported ones there, NAME.py")
        found += _described(files)
    return found


def _described(paths: Iterable[Path]) -> Iterator[dict[str, str]]:
    for path in paths:
        source = path.read_text(encoding="utf-8")
        lines = source.splitlines()
        title = lines[0].lstrip("# ") if lines and lines[0].startswith("#") else path.stem
        match = _FOR_ROBOT.search(source)
        robot, world = match.groups() if match else ("bench", "")
        # What comes before a name, such as 2b_, is its place among the examples.
        name = re.sub(r"^\d+[a-z]?_", "", path.name)
        yield {"title": title, "name": name, "source": source, "robot": robot, "world": world or ""}


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, ensure_ascii=False, separators=(",", ":")), "utf-8")


def _finish(site: Path) -> None:
    """Write the list of files and the service worker, which are named by what is in the site."""
    sizes = {}
    digest = hashlib.sha256()
    for path in sorted(site.rglob("*")):
        if path.is_file():
            name = path.relative_to(site).as_posix()
            content = path.read_bytes()
            sizes[name] = len(content)
            digest.update(name.encode() + b"\0" + content)
    worker = (STATIC / _SERVICE_WORKER).read_text(encoding="utf-8")
    digest.update(worker.encode())
    build = digest.hexdigest()[:16]
    (site / _SERVICE_WORKER).write_text(worker.replace(_BUILD_MARK, build), encoding="utf-8")
    _write_json(site / LIST, {"build": build, "files": sizes})


def _replace(out: Path, fresh: Path) -> None:
    """Put a fresh site in place of what is in a folder."""
    out.mkdir(parents=True, exist_ok=True)
    for path in out.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    shutil.copytree(fresh, out, dirs_exist_ok=True)
