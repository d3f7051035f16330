"""Robots' files for a tab, and their bodies on MuJoCo's JavaScript build."""

from __future__ import annotations

import io
import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import brickhub
import bricktwin
from benchmarks import tab_motion
from brickhub.errors import TwinError
from brickhub.robot import HubKind, Motor, Robot
from brickhub.virtual.run import run_file
from bricktwin.robots import BENCH, ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.planned import robot_of_plan
from bricktwin.site.packages import SiteError, node, unpack_packages
from bricktwin.site.robot_files import robot_file
from bricktwin.site.tab.plain_values import plain, read_plain
from bricktwin.site.tab.robot_file import body_of, robot_in, scene_in
from bricktwin.twin.body import TwinBody
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.make_body import make_body
from bricktwin.twin.models.kept_models import robot_model
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Block, Field, Lamp, Line, Picture, Ramp, Wall, oval
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

_MESH = mujoco.mjtGeom.mjGEOM_MESH
HERE = Path(__file__).parent
EXAMPLES = HERE.parents[3] / "examples"
ROOM = Scene(
    objects=(
        Line(oval(900, 500), closed=True),
        Field((60, 50), (200, 100), "black"),
        Wall((600, -400), (600, 400)),
        Block((250, 250), mass_g=100.0, spread_mm=(10, 10)),
        Lamp((300, 0, 200)),
        Ramp((-500, 0)),
    )
)
# How two versions of MuJoCo stack a block on the floor differs in the fifth digit.
FIXED = replace(ROOM, objects=tuple(item for item in ROOM.objects if not isinstance(item, Block)))
# On which side of its play a leg rests that stands on heel and toe, the last digit decides.
QUIET = Physics(
    distance_noise_mm=0.0,
    distance_noise_ratio=0.0,
    tilt_noise_deg=0.0,
    backlash_deg=0.0,
    gyro_noise_deg_s=0.0,
    acceleration_noise_mm_s2=0.0,
    color_noise_pct=0.0,
)
PROGRAM = """
from pybricks.hubs import PrimeHub
from pybricks.pupdevices import ColorSensor, Motor, UltrasonicSensor
from pybricks.parameters import Direction, Port
from pybricks.robotics import DriveBase
from pybricks.tools import wait

hub = PrimeHub()
left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
right = Motor(Port.A)
eyes = UltrasonicSensor(Port.C)
light = ColorSensor(Port.B)
base = DriveBase(left, right, 56, 130)
base.straight(150)
base.turn(90)
for _ in range(5):
    left.run(400)
    right.dc(30)
    wait(100)
    print(left.angle() // 4, right.angle() // 4, round(hub.imu.heading()), eyes.distance())
    print(light.color(), light.reflection(), hub.imu.up())
"""


def six_legs() -> Robot:
    return robot_of_plan(str(EXAMPLES / "15_six_legs.ldr"), "six-legs")


def on_mujoco(file: dict[str, Any], **arguments: Any) -> TwinBody:
    """The body of a file on MuJoCo's Python build."""
    return body_of(file, tab_motion.engine_of(json.dumps(file)), **arguments)


@pytest.mark.parametrize(
    ("robot", "scene"),
    [
        (SCOUT, ROOM),
        (WALKER, OPEN_FLOOR),
        (ROBO_ARM, Scene(ball=True)),
    ],
)
def test_file_has_an_equal_robot_scene_and_model(robot: Robot, scene: Scene) -> None:
    file = json.loads(json.dumps(robot_file(robot, scene), allow_nan=False))
    assert robot_in(file) == robot
    assert scene_in(file) == scene
    ours = robot_model(robot, scene)
    theirs = mujoco.MjModel.from_xml_string(file["mjcf"])
    assert theirs.nmat == theirs.ntex == theirs.ncam == theirs.nlight == 0
    for name, values in file["fields"].items():
        getattr(theirs, name).reshape(-1)[:] = values
    names = [mujoco.mj_id2name(ours, mujoco.mjtObj.mjOBJ_BODY, body) for body in range(ours.nbody)]
    assert [theirs.body(body).name for body in range(theirs.nbody)] == names
    same = [name for name in dir(ours) if name.startswith(("body_", "jnt_", "dof_", "actuator_"))]
    same += ["qpos0", "site_pos", "site_quat", "eq_data", "pair_friction", "tendon_length0"]
    # They count the geometries, of which those that are only seen are left out.
    same = [name for name in same if "geom" not in name and "bvh" not in name]
    assert len(same) > 80
    for name in same:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), name)
    for option in ("timestep", "integrator", "cone", "jacobian", "impratio", "gravity"):
        assert np.all(getattr(ours.opt, option) == getattr(theirs.opt, option)), option


def test_body_of_a_file_moves_as_the_robot_does() -> None:
    for robot in (TWO_WHEELER, WALKER):
        ours = MujocoBody(robot, OPEN_FLOOR, QUIET, 0)
        theirs = on_mujoco(robot_file(robot), physics=QUIET)
        for body in (ours, theirs):
            for time_ms in range(10, 500, 10):
                tab_motion.drive(body, time_ms)
                body.advance_to(time_ms)
        assert list(theirs.engine.qpos) == pytest.approx(list(ours.engine.qpos), abs=1e-9)
        assert tab_motion.readings(theirs) == pytest.approx(tab_motion.readings(ours), abs=1e-6)


def test_robot_of_a_users_file_is_known_by_the_files_name() -> None:
    robot = six_legs()
    file = robot_file(robot)
    assert robot.model is not None and "/" in robot.model
    assert robot_in(file) == replace(robot, model="15_six_legs.ldr")
    assert str(EXAMPLES) not in json.dumps(file)


def test_random_physics_hold_on_a_file_too() -> None:
    body = on_mujoco(robot_file(TWO_WHEELER), physics=RandomPhysics(), seed=1)
    assert isinstance(body.engine, MujocoEngine)
    assert body.physics != Physics()
    assert body.engine.parameters("body_mass") != list(body.engine.nominal("body_mass"))
    same = on_mujoco(robot_file(TWO_WHEELER), physics=RandomPhysics(), seed=1)
    assert same.physics == body.physics and same.tilt_deg() == body.tilt_deg()


def test_end_stops_of_a_scene_are_the_robots_in_a_file() -> None:
    file = robot_file(ROBO_ARM, Scene(end_stops={"grab": (-170.0, 5.0)}))
    assert robot_in(file).motor("grab").end_stops_deg == (-170.0, 5.0)
    assert not scene_in(file).end_stops


def test_plain_values_are_read_as_they_were() -> None:
    picture = Picture(bytes(range(12)), 2, (100.0, 100.0))
    for value in (replace(ROOM, objects=(picture,)), Physics(slope_deg=2.0), RandomPhysics(0.5)):
        assert read_plain(json.loads(json.dumps(plain(value)))) == value
    with pytest.raises(TwinError, match="plain values"):
        plain(Scene(readings={"eyes": lambda angles: 3.0}))


def test_robot_without_a_model_is_refused() -> None:
    with pytest.raises(TwinError, match="lies on the bench"):
        robot_file(BENCH)


TRAY = """
<mujoco>
  <asset><mesh name="wedge" vertex="0 0 0 .02 0 0 0 .02 0 0 0 .02"/></asset>
  <worldbody>
    <body name="tray" pos="0 0 0.1">
      <freejoint/>
      <geom type="box" size="0.06 0.05 0.01" mass="0.3"/>
      <geom name="hits" type="mesh" mesh="wedge" mass="0.01" contype="1" conaffinity="0"/>
      <geom name="is_hit" type="mesh" mesh="wedge" mass="0.01" contype="0" conaffinity="1"/>
      <geom name="paired" type="mesh" mesh="wedge" mass="0.01" contype="0" conaffinity="0"/>
      <geom name="seen" type="mesh" mesh="wedge" mass="0.01" contype="0" conaffinity="0"/>
      <body name="arm" pos="0 0 0.05">
        <joint name="arm" axis="0 0 1"/>
        <geom name="finger" size="0.01" mass="0.02" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <contact><pair geom1="finger" geom2="paired"/></contact>
</mujoco>
"""


def test_meshes_that_may_touch_something_stay_and_others_go(tmp_path: Path) -> None:
    path = tmp_path / "tray.xml"
    path.write_text(TRAY)
    robot = Robot("tray", HubKind.PRIME, motors=(Motor("arm", "A"),), model=str(path))
    ours = robot_model(robot, OPEN_FLOOR)
    theirs = mujoco.MjModel.from_xml_string(robot_file(robot)["mjcf"])

    def meshes(model: mujoco.MjModel) -> set[str]:
        kinds = zip(range(model.ngeom), model.geom_type, strict=True)
        return {model.geom(number).name for number, kind in kinds if kind == _MESH}

    assert meshes(ours) == {"hits", "is_hit", "paired", "seen"}
    assert meshes(theirs) == {"hits", "is_hit", "paired"}
    tray = theirs.body("tray")
    assert tray.mass[0] == pytest.approx(0.34), "what is only seen weighs, too"


# ---------------------------------------------------------------- in Node.js


IN_TAB = """
import contextlib, io, json, sys
from bricktwin.site.tab.mpy_cross import put_in_place
put_in_place(compile_in_tab)
from brickhub.virtual.run import run_file
from bricktwin.site.tab.plain_values import read_plain
from bricktwin.site.tab.robot_file import body_in_tab

folder, = ARGUMENTS
asked = json.load(open(f"{folder}/asked.json"))
physics = read_plain(asked["physics"])
answers = {"starts": {}, "positions": {}}

for name, file in asked["files"].items():
    handle = start_engine(json.dumps(file))
    body = body_in_tab(file, handle, physics)
    answers["starts"][name] = list(body.engine.qpos)
    positions = answers["positions"][name] = []
    for time_ms in range(10, 1001, 10):
        tab_motion.drive(body, time_ms)
        body.advance_to(time_ms)
        positions.append(list(body.engine.qpos))
    body.update_visuals()
    handle.end()

scout = asked["files"]["scout"]
body = body_in_tab(scout, start_engine(json.dumps(scout)), physics)
out, err = io.BytesIO(), io.StringIO()
code = run_file(f"{folder}/program.py", body, stdout=out, stderr=err)
answers["printed"] = [code, out.getvalue().decode(), err.getvalue()]
answers["modules"] = [name for name in ("numpy", "mujoco", "greenlet") if name in sys.modules]
print("ANSWERS " + json.dumps(answers))
"""


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a tab's worker answers, without a tab."""
    folder = tmp_path_factory.mktemp("node")
    try:
        program = node()
        unpack_packages(folder)
    except SiteError as error:
        pytest.skip(str(error))
    files = {"scout": robot_file(SCOUT, FIXED), "six-legs": robot_file(six_legs())}
    (folder / "asked.json").write_text(json.dumps({"physics": plain(QUIET), "files": files}))
    (folder / "program.py").write_text(PROGRAM)
    # What drives the robots is a script, not a module of the houses.
    (folder / "script.py").write_text(
        "from types import SimpleNamespace as _Space\n"
        f"_drive = {{'__name__': ''}}\nexec({Path(tab_motion.__file__).read_text()!r}, _drive)\n"
        f"tab_motion = _Space(**_drive)\n{IN_TAB}"
    )
    houses = [str(Path(str(house.__file__)).parents[1]) for house in (brickhub, bricktwin)]
    done = subprocess.run(
        [
            program,
            str(HERE / "in_node.mjs"),
            str(folder / "node_modules"),
            *houses,
            str(folder),
            "--",
            str(folder / "script.py"),
            "/folder_2",
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("ANSWERS ")]
    found: dict[str, Any] = json.loads(line.removeprefix("ANSWERS "))
    return {**found, "files": files, "folder": folder}


def test_tab_needs_neither_numpy_nor_mujoco(answers: dict[str, Any]) -> None:
    assert answers["modules"] == []


@pytest.mark.parametrize("name", ["scout", "six-legs"])
def test_robot_moves_in_javascript_as_in_python(name: str, answers: dict[str, Any]) -> None:
    body = on_mujoco(answers["files"][name], physics=QUIET)
    start = answers["starts"][name]
    assert start == pytest.approx(list(body.engine.qpos), abs=1e-6)
    # What is compared is the motion from one start, to the last digit.
    for address, position in enumerate(start):
        body.engine.qpos[address] = position
    body.engine.forward()
    for number, positions in enumerate(answers["positions"][name], 1):
        tab_motion.drive(body, 10 * number)
        body.advance_to(10 * number)
        assert positions == pytest.approx(list(body.engine.qpos), abs=1e-6)


def test_hub_program_in_javascript_prints_what_it_prints_here(answers: dict[str, Any]) -> None:
    out, err = io.BytesIO(), io.StringIO()
    body = make_body(SCOUT, scene=FIXED, physics=QUIET)
    code = run_file(answers["folder"] / "program.py", body, stdout=out, stderr=err)
    assert [code, out.getvalue().decode(), err.getvalue()] == answers["printed"]
    assert code == 0 and len(out.getvalue().splitlines()) == 10
