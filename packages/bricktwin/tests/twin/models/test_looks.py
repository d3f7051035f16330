"""Robots with LDraw looks: same physics."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from ldraw_library import write_robot_parts

from brickhub.errors import RenderingUnavailableError
from brickhub.robot import Robot
from bricktwin.plans import ldraw_library
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER
from bricktwin.twin.engines.conventions import LOOKS_GROUP
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import Image, Renderer
from bricktwin.twin.scene import OPEN_FLOOR


@pytest.fixture
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LDRAWDIR", raising=False)
    monkeypatch.setattr(ldraw_library, "_SYSTEM_FOLDERS", ())


def body(robot: Robot) -> MujocoBody:
    return MujocoBody(robot, OPEN_FLOOR, Physics(), 0)


def motion(robot: MujocoBody) -> bytes:
    """Positions after half a second with all motors on."""
    for port in [motor.port for motor in robot.robot.motors]:
        robot.set_voltage(port, 5000)
    robot.advance_to(500)
    return robot.data.qpos.tobytes() + robot.data.qvel.tobytes()


@pytest.mark.usefixtures("no_library")
def test_each_of_equal_legs_is_drawn_at_its_place() -> None:
    drawn = body(WALKER)
    names = []
    for number in range(1, drawn.model.nbody):
        is_of_body = drawn.model.geom_bodyid == number
        geoms = np.flatnonzero(is_of_body & (drawn.model.geom_group == LOOKS_GROUP))
        if len(geoms):
            name = drawn.model.body(number).name
            away_m = drawn.data.geom_xpos[geoms] - drawn.data.xpos[number]
            # The longest part, a beam of nine holes, hangs 5 cm below the axle that it turns on.
            assert np.linalg.norm(away_m, axis=1).max() < 0.06, name
            names.append(name)
    assert len(names) == 13, "the chassis, and three bodies for each of four legs"


@pytest.mark.usefixtures("no_library")
@pytest.mark.parametrize("robot", [TWO_WHEELER, WALKER, ROBO_ARM], ids=lambda robot: robot.name)
def test_looks_do_not_change_physics(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = body(robot)
    monkeypatch.setenv("LDRAWDIR", str(write_robot_parts(tmp_path)))
    theirs = body(robot)
    windows = [
        i
        for i in range(theirs.model.ngeom)
        if theirs.model.geom(i).matid >= 0 and _material(theirs.model, i) == "#10c02080"
    ]
    assert [int(theirs.model.geom_group[i]) for i in windows] == [LOOKS_GROUP], (
        "the hub's green window"
    )
    assert theirs.model.nmesh != ours.model.nmesh or theirs.model.nmeshvert != ours.model.nmeshvert
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature"):
        assert np.array_equal(getattr(ours.model, name), getattr(theirs.model, name)), name
    assert motion(ours) == motion(theirs)


def _material(model: mujoco.MjModel, geom: int) -> str:
    return str(model.material(int(model.geom_matid[geom])).name)


@pytest.mark.usefixtures("no_library")
def test_looks_change_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def picture() -> Image:
        with Renderer(body(TWO_WHEELER), 160, 120, "portrait") as renderer:
            return renderer.render()

    try:
        ours = picture()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    monkeypatch.setenv("LDRAWDIR", str(write_robot_parts(tmp_path)))
    theirs = picture()
    assert _green(ours) == 0
    assert _green(theirs) > 50, "the hub's window"


def _green(image: Image) -> int:
    red, green, blue = (image[..., channel].astype(int) for channel in range(3))
    return int(((green > red + 40) & (green > blue + 40)).sum())
