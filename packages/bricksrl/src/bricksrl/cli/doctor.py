"""``bricksrl doctor``: check of this computer for everything that BricksRL needs."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated

from brickhub.cli.options import JsonFlag, option
from brickhub.cli.terminal import print_findings
from bricksrl.errors import DescriptionError
from brickhub.finding import Finding, Outcome

_MIN_PYTHON = (3, 11)
_LOW_SPACE_GB, _NO_SPACE_GB = 5.0, 0.5
_SCAN_S = 1.0
_MAX_TIMEOUT_S = 3600.0
_DRAW = """
from bricktwin import robots
from bricktwin.twin.make_body import make_body
from bricktwin.twin.render.opengl import Renderer
with Renderer(make_body(robots.get("two-wheeler")), 32, 24) as renderer:
    renderer.render()
"""
_DRAW_S = 45.0
_WITHOUT_ROBOT = "the virtual hub needs none of it"

Answer = tuple[Outcome, str]


@dataclass(frozen=True)
class Doctor:
    """Check this computer: Python, packages, compiler, physics, OpenGL, OpenCV, Bluetooth, USB, disk.

    One line per check, with advice; exit code 1 if a required part is missing.

    Examples:
      bricksrl doctor
      bricksrl doctor --json
    """

    timeout_s: Annotated[float, option(metavar="SECONDS")] = 60.0
    """Timeout of each check."""
    json: JsonFlag = False

    def execute(self) -> int:
        if not 0 < self.timeout_s <= _MAX_TIMEOUT_S:
            raise DescriptionError(f"timeout-s is {self.timeout_s:g}; give a positive number of up to {_MAX_TIMEOUT_S:g}")
        findings = (run_check(name, check, self.timeout_s) for name, check in CHECKS.items())
        return print_findings(findings, (9, 12), as_json=self.json)


def run_check(name: str, check: Callable[[], Answer], timeout_s: float) -> Finding:
    """Finding of a check, also if it raises or exceeds the timeout; it is then left running in its thread."""
    answers: list[Answer] = []

    def run() -> None:
        try:
            answers.append(check())
        except BaseException as error:  # noqa: BLE001  a broken package may raise anything
            answers.append((Outcome.ERROR, f"{type(error).__name__}: {' '.join(str(error).split())}; install bricksrl again"))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(timeout_s)
    outcome, detail = answers[0] if answers else (Outcome.WARNING, f"no answer within {timeout_s:g} s; look at it by itself")
    return Finding(name, outcome, detail)


def check_python() -> Answer:
    """Check the version of Python."""
    version = f"{platform.python_version()}, {platform.system()} {platform.machine()}"
    if sys.version_info < _MIN_PYTHON:
        return Outcome.ERROR, f"{version}; install Python 3.11 or later"
    return Outcome.OK, version


def check_packages() -> Answer:
    """Check the required packages and their versions."""
    from packaging.requirements import Requirement

    installed, faults = [], []
    for text in metadata.requires("bricksrl") or []:
        requirement = Requirement(text)
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            version = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            faults.append(f"{requirement.name} is missing")
            continue
        installed.append(requirement.name)
        if not requirement.specifier.contains(version, prereleases=True):
            faults.append(f"{requirement.name} {version} is not {requirement.specifier}")
    if faults:
        return Outcome.ERROR, f"{'; '.join(faults)}; run `pip install bricksrl` again"
    main = ", ".join(f"{name} {metadata.version(name)}" for name in ("bricksrl", "torch", "torchrl", "mujoco", "bleak"))
    return Outcome.OK, f"{main}, and {len(installed) - 4} more"


def check_compiler() -> Answer:
    """Check that the compiler of hub programs runs."""
    from brickhub.hub.program.compile import compile_mpy

    return Outcome.OK, f"mpy-cross makes {len(compile_mpy('print(1)'))} bytes of one line"


def check_physics() -> Answer:
    """Check that MuJoCo simulates a falling body."""
    from bricktwin.twin.make_body import check_mujoco

    check_mujoco()
    import mujoco

    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    if not data.qpos[2] < 0.0:
        return Outcome.ERROR, "MuJoCo loads, but nothing falls; install mujoco again"
    return Outcome.OK, f"MuJoCo {mujoco.__version__}"


def check_opengl() -> Answer:
    """Check that OpenGL renders, in a separate process, because a broken driver may crash it."""
    try:
        process = subprocess.run([sys.executable, "-c", _DRAW], capture_output=True, text=True, timeout=_DRAW_S, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        return Outcome.WARNING, f"nothing was drawn within {_DRAW_S:g} s; all but pictures and videos works"
    if process.returncode == 0:
        return Outcome.OK, f"draws ({os.environ.get('MUJOCO_GL', 'the library that was found')})"
    last = (process.stderr.strip().splitlines() or [f"exit code {process.returncode}"])[-1]
    return Outcome.WARNING, f"no pictures and videos: {last.rpartition('Error: ')[2]}; all the rest works without"


def check_opencv() -> Answer:
    """Check that OpenCV is installed."""
    try:
        import cv2
    except ImportError as error:
        return Outcome.WARNING, f"none ({error}); `pip install bricksrl[vision]` where a task has a real camera"
    return Outcome.OK, f"OpenCV {cv2.__version__}"


def check_bluetooth() -> Answer:
    """Check that hubs can be scanned for; on Linux also why not."""
    from brickhub.hub.errors import BluetoothUnavailableError
    from brickhub.hub.transports.bluetooth import bluetooth_problem
    from brickhub.hub.transports.scan import scan

    fault = bluetooth_problem()
    if fault is not None:
        return Outcome.WARNING, f"{fault[1]}; {_WITHOUT_ROBOT}"
    try:
        hubs = scan(_SCAN_S)
    except BluetoothUnavailableError as error:
        return Outcome.WARNING, f"{error}; {_WITHOUT_ROBOT}"
    names = ", ".join(hub.name for hub in hubs) or "no hub in reach right now"
    return Outcome.OK, f"can look for hubs: {names}"


def check_usb() -> Answer:
    """List the serial ports; a hub on a cable is one of them."""
    from serial.tools.list_ports import comports

    ports = sorted(port.device for port in comports())
    return Outcome.OK, f"serial ports: {', '.join(ports) or 'none'}"


def check_disk() -> Answer:
    """Check free space and write permission in the working folder."""
    folder = Path.cwd()
    free_gb = shutil.disk_usage(folder).free / 1e9
    space = f"{free_gb:.1f} GB free in {folder}"
    if not os.access(folder, os.W_OK):
        return Outcome.WARNING, f"{folder} cannot be written to; go to another folder, or give --run a path elsewhere"
    if free_gb < _NO_SPACE_GB:
        return Outcome.ERROR, f"{space}; make room, a run takes some hundred megabytes"
    if free_gb < _LOW_SPACE_GB:
        return Outcome.WARNING, f"{space}; runs with pictures take several gigabytes"
    return Outcome.OK, space


CHECKS: dict[str, Callable[[], Answer]] = {
    "python": check_python,
    "packages": check_packages,
    "compiler": check_compiler,
    "physics": check_physics,
    "opengl": check_opengl,
    "opencv": check_opencv,
    "bluetooth": check_bluetooth,
    "usb": check_usb,
    "disk": check_disk,
}
