"""Models that are kept in the user's cache."""

from __future__ import annotations

import functools
import itertools
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from ldraw_library import write_robot_parts

import brickhub
import bricktwin
from brickhub.errors import DescriptionError, PlanError, TwinError
from brickhub.robot import (
    Chassis,
    DriveBase,
    HubKind,
    Motor,
    Mount,
    PoweredUpSensor,
    Robot,
    SensorKind,
)
from bricktwin import kept
from bricktwin.robots import ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.planned import plan_file, robot_of_plan
from bricktwin.twin import mujoco_arena, mujoco_body
from bricktwin.twin.arena import Arena, Contestant, Place
from bricktwin.twin.make_body import make_body
from bricktwin.twin.model_physics import backlash_joints
from bricktwin.twin.models import load
from bricktwin.twin.models.kept_models import _encoded, kept_model
from bricktwin.twin.models.load import load_model
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Block, Line, Wall
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

BUMP = PoweredUpSensor("bump", "F", SensorKind.FORCE, Mount((90, 0, 28), "ahead"))
GENERATED = Robot(
    "car",
    HubKind.TECHNIC,
    (Motor("left", "A"), Motor("right", "B")),
    drive_base=DriveBase("left", "right", 56, 120),
    sensors=(),
)
ROOM = Scene(
    objects=(Line(((0, 0), (300, 0))), Wall((500, -100), (500, 100)), Block((200, 0), mass_g=30.0)),
    start_mm=((0, 9), (0, 0)),
)
PLAN = Path(str(plan_file(str(TWO_WHEELER.model))))

MJCF = """<mujoco><asset><mesh name="case" file="case.obj"/></asset>
<include file="{include}"/></mujoco>"""
BODY = """<mujocoinclude><worldbody><body name="base" pos="0 0 0.1"><freejoint/><geom type="mesh" mesh="case" mass="0.1"/>
<body><joint name="left" axis="0 1 0"/><geom size="0.03" mass="0.02"/></body></body></worldbody></mujocoinclude>"""  # noqa: E501
MESH = "v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 {size}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

CHILD = """
import hashlib, sys
import mujoco
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.model_physics import backlash_joints
from bricktwin.twin.models.kept_models import _encoded
body = make_body(TWO_WHEELER)
how = "built" if "bricktwin.twin.models.load" in sys.modules else "kept"
print(how, hashlib.sha256(_encoded(body.engine._nominal)).hexdigest())
"""


@dataclass
class Cache:
    """A cache of the test's own, and the robots whose models were built."""

    folder: Path
    built: list[str]

    def body(
        self,
        robot: Robot,
        scene: Scene = OPEN_FLOOR,
        physics: Physics | RandomPhysics | None = None,
    ) -> MujocoBody:
        """A body as the first of a process."""
        mujoco_body._compiled.cache_clear()
        body = make_body(robot, scene=scene, physics=physics)
        assert isinstance(body, MujocoBody)
        return body

    @property
    def files(self) -> list[Path]:
        """Kept models, which are larger than facts of plans."""
        files = (self.folder / "bricksrl" / "kept").glob("*")
        return [path for path in files if path.stat().st_size > 50_000]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cache:
    cache = Cache(tmp_path / "cache", [])
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache.folder))
    monkeypatch.delenv("LDRAWDIR", raising=False)
    # Also while somebody edits it.
    monkeypatch.setattr(kept, "_code", functools.cache(lambda: b"code"))
    monkeypatch.setattr(kept, "_written", itertools.count())

    def recorded(robot: Robot, scene: Scene, **options: bool) -> mujoco.MjSpec:
        cache.built.append(robot.name)
        return load_model(robot, scene, **options)

    monkeypatch.setattr(load, "load_model", recorded)
    return cache


def assert_equal(one: mujoco.MjModel, other: mujoco.MjModel) -> None:
    """Equal in every array and option."""
    names = [name for name in dir(one) if isinstance(getattr(one, name), np.ndarray)]
    assert len(names) > 300
    for name in names:
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name
    assert _encoded(one) == _encoded(other)


def driven(body: MujocoBody) -> list[bytes]:
    """States on the way with all motors on, and what is drawn."""
    states = []
    for number, motor in enumerate(body.robot.motors):
        body.set_voltage(motor.port, 4000 - 1500 * number)
    for time_ms in range(100, 800, 100):
        body.advance_to(time_ms)
        body.update_visuals()
        states += [
            body.data.qpos.tobytes(),
            body.data.qvel.tobytes(),
            body.data.geom_xpos.tobytes(),
            body.model.body_quat.tobytes(),
        ]
    return states


@pytest.mark.parametrize(
    ("robot", "scene"),
    [
        (WALKER, OPEN_FLOOR),
        (ROBO_ARM, Scene(ball=True)),
        (replace(SCOUT, sensors=(*SCOUT.sensors, BUMP)), ROOM),
        (GENERATED, OPEN_FLOOR),
    ],
    ids=["walker", "robo-arm", "scout", "generated"],
)
def test_kept_model_equals_built_one(robot: Robot, scene: Scene, cache: Cache) -> None:
    built, loaded = cache.body(robot, scene), cache.body(robot, scene)
    assert cache.built == [robot.name] and len(cache.files) == 1
    assert_equal(built.engine._nominal, loaded.engine._nominal)
    assert built._turning.spinners == loaded._turning.spinners
    assert built._turning.rods == loaded._turning.rods
    assert backlash_joints(built.engine) == backlash_joints(loaded.engine)
    assert built.motors.terminals == loaded.motors.terminals
    assert built.motors.shafts == loaded.motors.shafts
    assert driven(built) == driven(loaded)


def test_kept_arena_equals_built_one(cache: Cache) -> None:
    def world(at_m: float) -> ArenaWorld:
        mujoco_arena._compiled.cache_clear()
        places = (Place(), Place(x_m=(at_m, at_m)))
        robots = zip("ab", (WALKER, TWO_WHEELER), places, strict=True)
        return ArenaWorld(Arena(tuple(Contestant(*robot) for robot in robots), half_size_m=(1, 1)))

    built, loaded = world(0.5), world(0.5)
    assert cache.built == ["walker", "two-wheeler"]
    assert_equal(built.engine._nominal, loaded.engine._nominal)
    assert len(loaded.bodies[0]._turning.rods) == len(built.bodies[0]._turning.rods) == 4
    world(0.6)
    assert len(cache.built) == 4


def test_physics_is_not_kept(cache: Cache) -> None:
    nominal = driven(cache.body(TWO_WHEELER))
    changed = cache.body(TWO_WHEELER, physics=Physics(mass_scale=1.5, backlash_deg=6.0))
    drawn = cache.body(TWO_WHEELER, physics=RandomPhysics())
    assert cache.built == ["two-wheeler"]
    assert driven(changed) != nominal != driven(drawn)
    assert driven(cache.body(TWO_WHEELER)) == nominal


def test_other_scene_or_robot_has_another_model(cache: Cache) -> None:
    red = Line(((0, 0), (300, 0)), color="red")
    different = [
        (TWO_WHEELER, OPEN_FLOOR),
        (TWO_WHEELER, Scene(wall_distance_mm=(200, 300))),
        (TWO_WHEELER, ROOM),
        (TWO_WHEELER, replace(ROOM, objects=(red, *ROOM.objects[1:]))),
        (replace(TWO_WHEELER, name="other"), OPEN_FLOOR),
        (SCOUT, OPEN_FLOOR),
        (GENERATED, OPEN_FLOOR),
        (replace(GENERATED, chassis=Chassis(ballast_g=1.0)), OPEN_FLOOR),
    ]
    for count, (robot, scene) in enumerate(different, 1):
        built = cache.body(robot, scene)
        assert len(cache.built) == count, (robot, scene)
        assert_equal(cache.body(robot, scene).engine._nominal, built.engine._nominal)
        assert len(cache.built) == count, (robot, scene)


@pytest.mark.parametrize("changed", ["car.ldr", "pin.ldr"])
def test_changed_plan_or_file_beside_it_is_built_anew(
    changed: str, cache: Cache, tmp_path: Path
) -> None:
    pin = "1 0 70 -100 40 1 0 0 0 0 -1 0 1 0 2780.dat"
    whole = PLAN.read_text()
    assert pin in whole
    # With one of its pins in a file of its own.
    (tmp_path / "car.ldr").write_text(
        whole.replace(pin, "1 16 0 0 0 1 0 0 0 1 0 0 0 1 pin.ldr") + f"{pin}\n"
    )
    (tmp_path / "pin.ldr").write_text(f"{pin}\n")
    robot = replace(TWO_WHEELER, model=str(tmp_path / "car.ldr"))
    first = cache.body(robot)
    cache.body(robot)
    assert len(cache.built) == 1
    file = tmp_path / changed
    state = file.stat()
    file.write_text(file.read_text().replace("2780.dat", "6558.dat"))  # a longer pin
    os.utime(file, ns=(state.st_atime_ns, state.st_mtime_ns))  # as tools do that copy files
    second = cache.body(robot)
    assert len(cache.built) == 2
    assert second.engine._nominal.body_mass.sum() != first.engine._nominal.body_mass.sum()


@pytest.mark.parametrize("changed", ["robot.xml", "body.xml", "case.obj"])
def test_changed_mjcf_include_or_mesh_is_built_anew(
    changed: str, cache: Cache, tmp_path: Path
) -> None:
    texts = {
        "robot.xml": MJCF.format(include="body.xml"),
        "body.xml": BODY,
        "case.obj": MESH.format(size=0.05),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    robot = Robot("mine", HubKind.PRIME, (Motor("left", "A"),), model=str(tmp_path / "robot.xml"))
    for _ in range(2):
        assert cache.body(robot).engine._nominal.nmesh == 1
    assert len(cache.built) == 1
    other = {"0.05": "0.07", "0.02": "0.04", "<asset>": "<asset >"}
    text = texts[changed]
    for old, new in other.items():
        text = text.replace(old, new)
    (tmp_path / changed).write_text(text)
    cache.body(robot)
    assert len(cache.built) == 2


@pytest.mark.parametrize("faulty", ["", "<mujoco><worldbody>", MJCF.format(include="no.xml")])
def test_faulty_mjcf_is_told_as_before(
    faulty: str, cache: Cache, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if faulty:
        Path("robot.xml").write_text(faulty)
    robot = Robot("mine", HubKind.PRIME, model="robot.xml")
    for _ in range(2):
        with pytest.raises(TwinError, match=r"robot\.xml (is not an MJCF|of robot 'mine'; give)"):
            cache.body(robot)
    assert not Path("MUJOCO_LOG.TXT").exists() and not cache.files


def test_other_ldraw_library_is_drawn_anew(
    cache: Cache, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = cache.body(TWO_WHEELER)
    root = write_robot_parts(tmp_path / "ldraw")
    monkeypatch.setenv("LDRAWDIR", str(root))
    theirs = cache.body(TWO_WHEELER)
    assert theirs.engine._nominal.nmeshvert != ours.engine._nominal.nmeshvert
    assert_equal(cache.body(TWO_WHEELER).engine._nominal, theirs.engine._nominal)
    assert len(cache.built) == 2
    (root / "parts" / "99999.dat").write_text("0 a new part\n")
    cache.body(TWO_WHEELER)
    assert len(cache.built) == 3


def function(robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """A user's function."""
    return load_model(replace(robot, model=TWO_WHEELER.model), scene)


def test_model_of_a_function_is_not_kept(cache: Cache) -> None:
    robot = replace(TWO_WHEELER, model=f"{__name__}:function")
    for count in (1, 2):
        cache.body(robot)
        assert len(cache.built) == count
    assert not cache.files


def test_file_of_another_mujoco_is_built_anew(
    cache: Cache, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log there
    with monkeypatch.context() as context:
        context.setattr("bricktwin.twin.models.kept_models._encoded", lambda _: b"another form")
        cache.body(GENERATED)
    cache.body(GENERATED)
    assert len(cache.built) == 2
    cache.body(GENERATED)
    assert len(cache.built) == 2
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "5.0.0")
    cache.body(GENERATED)
    assert len(cache.built) == 3


def test_processes_share_a_model_until_a_line_of_code_changes(tmp_path: Path) -> None:
    for house in (brickhub, bricktwin):
        source = Path(house.__path__[0])
        shutil.copytree(source, tmp_path / source.name, ignore=shutil.ignore_patterns("*.pyc"))
    time.sleep(0.05)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("LDRAWDIR", None)

    def start() -> subprocess.Popen[str]:
        command = [sys.executable, "-c", CHILD]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)

    def result(child: subprocess.Popen[str]) -> list[str]:
        output, _ = child.communicate(timeout=120)
        return output.split()

    (one, first), (other, second) = map(result, [start(), start()])
    assert {one, other} <= {"built", "kept"} and first == second
    assert result(start()) == ["kept", first]
    names = [path.name for path in (tmp_path / "bricksrl" / "kept").iterdir()]
    assert len(names) == 2 and not any(name.startswith(".") for name in names), (
        "a model and the facts of its plan"
    )
    path = tmp_path / "bricktwin/twin/models/mjcf.py"
    text = path.read_text(encoding="utf-8")
    assert "TYRE_FRICTION = 1.0" in text
    path.write_text(text.replace("TYRE_FRICTION = 1.0", "TYRE_FRICTION = 0.95"), "utf-8")
    time.sleep(0.05)
    how, third = result(start())
    assert how == "built" and third != first


def test_kept_facts_complete_as_the_plan_does(
    cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = DriveBase("left", "right")
    first = robot_of_plan(PLAN, "mine", drive_base=base, needs_imu=True)
    body = cache.body(first)
    monkeypatch.setattr("bricktwin.plans.planned_robot.planned_robot", pytest.fail)
    assert robot_of_plan(PLAN, "mine", drive_base=base, needs_imu=True) == first
    assert_equal(cache.body(first).engine._nominal, body.engine._nominal)
    assert cache.built == ["mine"]
    with pytest.raises(DescriptionError, match="port A has .* 'right' in the plan, but .* 'left'"):
        robot_of_plan(PLAN, "mine", motors=(Motor("left", "A"),))


def test_faulty_plan_raises_each_time(cache: Cache, tmp_path: Path) -> None:
    plan = tmp_path / "car.ldr"
    plan.write_text("1 4 0 0 0 1 0 0 0 1 0 0 0 1 54696.dat\n")
    for _ in range(2):
        with pytest.raises(PlanError, match="line 1: .* has no port"):
            robot_of_plan(plan)
    assert not cache.folder.exists()


@pytest.mark.parametrize("joints", [59, 60])
def test_large_models_use_dense_matrices(joints: int) -> None:
    """MuJoCo 4.0.0 takes sparse ones from 60 degrees of freedom on, and their factor is wrong."""
    link = '<body pos="0 {} 0"><joint type="hinge"/><geom size="0.1"/></body>'
    links = "".join(link.format(number) for number in range(joints))

    def built() -> mujoco.MjSpec:
        return mujoco.MjSpec.from_string(f"<mujoco><worldbody>{links}</worldbody></mujoco>")

    model = kept_model(built, [], f"{joints} links")
    assert model.nv == joints and not mujoco.mj_isSparse(model)
    assert bool(mujoco.mj_isSparse(built().compile())) is (joints >= 60), "without us"
