"""Folder of the site: pages, scripts, runtimes, the houses of this project, programs and robots."""

import hashlib
import json
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from brickhub.robot import Robot
from bricktwin.robots import CART
from bricktwin.site.houses import kit_package
from bricktwin.site.names import bluetooth_names, device_table, pybricks_names
from bricktwin.site.packages import SiteError
from bricktwin.site.robots import OWN, write_robots, write_together
from bricktwin.site.runtimes import put_runtimes
from bricktwin.site.storing import write_json, write_packed
from bricktwin.site.tab.plain_values import read_plain
from bricktwin.twin.scene import Scene
from bricktwin.view.script import FOLDER as VIEW
from bricktwin.worlds import WORLDS, world

_HERE = Path(__file__).parent
STATIC = _HERE / "static"
WORKER = _HERE / "worker"
PROGRAMS = _HERE / "programs"
DEVICES = PROGRAMS / "devices"
LIST = "files.json"
"""List of all files of a site with their sizes, by which a site is known."""
_SERVICE_WORKER = "service_worker.js"
_BUILD_MARK = "BUILD-MARK"
_FOR_ROBOT = re.compile(r"(?m)^# Robot: ([\w.-]+) ?([\w-]*)$")
_PARTNER = re.compile(r"(?m)^# With: ([\w.-]+)$")
_DEVICE = re.compile(r"(?m)^# Port: \w+=([\w.-]+\.py)(?::\w+)?$")
_IMPORTED = re.compile(r'from "\./(\w+\.js)"')
_NOT_COPIED = (_SERVICE_WORKER,)


def build_site(
    out: Path,
    robots: Sequence[Robot] = OWN,
    policies: Path | None = None,
    worlds: Sequence[str] = tuple(WORLDS),
    scenes: Mapping[str, Scene] | None = None,
    *,
    has_kits: bool = False,
) -> list[Path]:
    """Make a site in a folder, which is new, empty, or a site that is replaced.

    Args:
        out: the folder.
        robots: those that can be chosen, the first one at first.
        policies: folder of hub programs, ``NAME.py``, that are offered beside ours, and of the
            worlds that they name, ``WORLD.json``.
        worlds: those that can be chosen for robots that drive, beside the open floor.
        scenes: further worlds for these, by name, such as a user's picture as the floor.
        has_kits: whether it has LEGO's package for its kits of 2026, as it is installed here, and
            the cart.

    Returns:
        All files of the site.

    Raises:
        SiteError: the folder is something else, or what the site is made of cannot be fetched.
        MediumUnavailableError: LEGO's package is not installed.
        TwinError: a robot has no model.
    """
    check_folder(out)
    offered = programs(policies)
    drivers_worlds = {name: world(name) for name in worlds} | dict(scenes or {})
    with tempfile.TemporaryDirectory(prefix="bricktwin-site-") as folder:
        fresh = Path(folder) / "site"
        fresh.mkdir()
        _copy_pages(fresh)
        put_runtimes(fresh)
        if has_kits:
            write_packed(fresh / "kits.zip", kit_package())
            robots = (*robots, CART)
        index = write_robots(fresh, robots, drivers_worlds, _named_worlds(offered, policies))
        write_json(fresh / "robots.json", index)
        write_json(fresh / "together.json", write_together(fresh, robots, drivers_worlds, index))
        write_json(fresh / "programs.json", offered)
        write_json(fresh / "pybricks.json", pybricks_names())
        write_json(fresh / "devices.json", device_table())
        write_json(fresh / "bluetooth.json", bluetooth_names())
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
    # Both lie in one folder of the site: what the worker imports, the page may import too.
    for path in (*STATIC.iterdir(), *WORKER.iterdir()):
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


def programs(policies: Path | None) -> list[dict[str, Any]]:
    """Programs that the page offers: title, file name, source, the robot and world it is for, the
    program of a second hub, and ``files``, further ones by name.

    The first line of each is a comment with its title; a second one, ``# Robot: ROBOT WORLD``,
    names the robot and the world, else it is for the bench. A line ``# With: NAME.py`` names what
    another hub runs in the same room; it is empty for a hub alone. A line ``# Port:
    A=NAME.py:DEVICE`` names a device of one's own, whose file is in `DEVICES`.
    """
    found = list(_described(sorted(PROGRAMS.glob("*.py"))))
    if policies is not None:
        files = sorted(policies.glob("*.py"))
        if not files:
            raise SiteError(f"{policies} has no programs; put exported ones there, NAME.py")
        found += _described(files)
    return found


def _named_worlds(
    offered: Iterable[Mapping[str, Any]],
    policies: Path | None,
) -> dict[str, dict[str, Scene]]:
    """Worlds that programs bring with them, by robot and name."""
    found: dict[str, dict[str, Scene]] = {}
    for program in offered:
        name = program["world"]
        file = None if policies is None else policies / f"{name}.json"
        if name in WORLDS or file is None or not file.is_file():
            continue
        try:
            scene = read_plain(json.loads(file.read_text(encoding="utf-8")))
        except (ValueError, KeyError, TypeError):
            scene = None
        if not isinstance(scene, Scene):
            raise SiteError(
                f"{file} is not the world of a policy; `bricksrl export --format hub` writes it "
                "beside the program"
            )
        found.setdefault(program["robot"], {})[name] = scene
    return found


def _described(paths: Iterable[Path]) -> Iterator[dict[str, Any]]:
    for path in paths:
        source = path.read_text(encoding="utf-8")
        lines = source.splitlines()
        title = lines[0].lstrip("# ") if lines and lines[0].startswith("#") else path.stem
        match = _FOR_ROBOT.search(source)
        robot, world = match.groups() if match else ("bench", "")
        # What comes before a name, such as 2b_, is its place among the examples.
        name = re.sub(r"^\d+[a-z]?_", "", path.name)
        partner = _PARTNER.search(source)
        files = {
            device: (DEVICES / device).read_text(encoding="utf-8")
            for device in _DEVICE.findall(source)
            # One of somebody's own program is that person's.
            if (DEVICES / device).is_file()
        }
        yield {
            "title": title,
            "name": name,
            "source": source,
            "robot": robot,
            "world": world or "",
            "partner": partner[1] if partner else "",
            "files": files,
        }


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
    write_json(site / LIST, {"build": build, "files": sizes})


def _replace(out: Path, fresh: Path) -> None:
    """Put a fresh site in place of what is in a folder."""
    out.mkdir(parents=True, exist_ok=True)
    for path in out.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    shutil.copytree(fresh, out, dirs_exist_ok=True)
