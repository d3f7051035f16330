"""``bricksrl doctor``: check of this computer for everything that BricksRL needs."""

import os
import shutil
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from brickhub.cli import doctor
from brickhub.cli.doctor import Answer
from brickhub.errors import WriteError
from brickhub.files import check_writable, temporary_beside
from brickhub.finding import Outcome
from bricksrl.child_process import own_python
from bricktwin.twin.make_body import check_mujoco

_LOW_SPACE_GB = 5.0
_NO_SPACE_GB = 0.5
_DRAW = """
from brickhub.target import find
from bricktwin.twin.render.opengl import Renderer
with Renderer(find("two-wheeler").make_body(), 32, 24) as renderer:
    renderer.render()
"""
_DRAW_S = 45.0


def check_physics() -> Answer:
    """Check that MuJoCo simulates a falling body."""
    check_mujoco()
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    if not data.qpos[2] < 0.0:
        return Outcome.ERROR, "MuJoCo loads, but nothing falls; install mujoco again"
    return Outcome.OK, f"MuJoCo {mujoco.__version__}"


def check_opengl() -> Answer:
    """Check that OpenGL renders, in a separate process, because a broken driver may crash it."""
    command, variables = own_python("-c", _DRAW)
    try:
        process = subprocess.run(  # noqa: S603  our own interpreter
            command,
            env=variables,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_DRAW_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return (
            Outcome.WARNING,
            f"nothing was drawn within {_DRAW_S:g} s; all but pictures and videos works",
        )
    if process.returncode == 0:
        return Outcome.OK, f"draws ({os.environ.get('MUJOCO_GL', 'the library that was found')})"
    # The last line of a traceback says what was wrong; a crash of a driver says nothing.
    lines = process.stderr.strip().splitlines()
    last = lines[-1] if lines else f"exit code {process.returncode}"
    return (
        Outcome.WARNING,
        f"no pictures and videos: {last.rpartition('Error: ')[2]}; all the rest works without",
    )


def check_opencv() -> Answer:
    """Check that OpenCV is installed."""
    try:
        import cv2
    except ImportError as error:
        return (
            Outcome.WARNING,
            f'none ({error}); `pip install "bricksrl[vision]"` where a task has a real camera',
        )
    return Outcome.OK, f"OpenCV {cv2.__version__}"


def check_disk() -> Answer:
    """Check free space and write permission in the working folder."""
    folder = Path.cwd()
    free_gb = shutil.disk_usage(folder).free / 1e9
    space = f"{free_gb:.1f} GB free in {folder}"
    try:
        check_writable(temporary_beside(folder / "run"))
    except WriteError:
        return (
            Outcome.WARNING,
            f"{folder} cannot be written to; go to another folder, or give --run a path elsewhere",
        )
    if free_gb < _NO_SPACE_GB:
        return Outcome.ERROR, f"{space}; make room, a run takes some hundred megabytes"
    if free_gb < _LOW_SPACE_GB:
        return Outcome.WARNING, f"{space}; runs with pictures take several gigabytes"
    return Outcome.OK, space


CHECKS: dict[str, Callable[[], Answer]] = {
    "python": doctor.check_python,
    "packages": partial(
        doctor.check_packages,
        ("bricksrl", "bricktwin", "brickhub"),
        ("bricksrl", "torch", "torchrl", "mujoco", "bleak"),
    ),
    "compiler": doctor.check_compiler,
    "physics": check_physics,
    "opengl": check_opengl,
    "opencv": check_opencv,
    "bluetooth": doctor.check_bluetooth,
    "usb": doctor.check_usb,
    "disk": check_disk,
}


@dataclass(frozen=True)
class Doctor(doctor.Doctor):
    """Check this computer: Python, packages, compiler, physics, OpenGL, OpenCV, Bluetooth, USB,
    disk.

    One line per check, with advice; exit code 1 if a required part is missing.

    Examples:
      bricksrl doctor
      bricksrl doctor --json
    """

    checks: ClassVar[Mapping[str, Callable[[], Answer]]] = CHECKS
