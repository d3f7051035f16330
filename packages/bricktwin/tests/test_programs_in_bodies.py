"""Any Pybricks program in a body: robots of plans move as they are built, and a log changes
nothing."""

from __future__ import annotations

import io
from importlib import resources
from pathlib import Path

import pytest

from brickhub.errors import DescriptionError
from brickhub.pytest_plugin import PybricksHub
from brickhub.target import find
from brickhub.virtual.machine import Machine
from brickhub.virtual.run import Operation, run_file
from brickhub.virtual.run_log import RunLog
from bricktwin import robots
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.scene import Scene

PLANS = Path(str(resources.files("bricktwin.robots.plans")))
FRONT_STEERED = Path(__file__).parents[3] / "examples" / "13_front_steered.ldr"
HEAD = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Direction, Port
from pybricks.pupdevices import ColorSensor, Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import multitask, run_task, wait
hub = PrimeHub()
"""
BASE = "base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)\n"
SENSES = """
base.drive(100, 20)
for _ in range(40):
    print(SENSOR, hub.imu.tilt(), hub.imu.angular_velocity(), hub.imu.acceleration(), hub.imu.heading())
    print(base.state(), hub.imu.rotation(Axis.Z), hub.imu.stationary())
    wait(13)
"""  # noqa: E501


@pytest.mark.parametrize(
    ("robot", "sensor", "read", "row_count"),
    [
        ("two-wheeler", "UltrasonicSensor(Port.C)", "distance()", 52),
        ("scout", "ColorSensor(Port.B)", "hsv()", 56),
    ],
)
def test_a_run_with_a_log_is_the_same_as_one_without(
    robot: str, sensor: str, read: str, row_count: int, tmp_path: Path
) -> None:
    source = f"{HEAD}{BASE}sensor = {sensor}\n{SENSES.replace('SENSOR', f'sensor.{read}')}"
    path, log = tmp_path / "main.py", RunLog()
    path.write_text(source)

    def printed(log: RunLog | None, seed: int = 0) -> list[str]:
        def attend(machine: Machine) -> None:
            machine.log = log

        out, err = io.BytesIO(), io.StringIO()
        body = make_body(robots.get(robot), scene=Scene(wall_distance_mm=(600, 600)), seed=seed)
        assert (
            run_file(path, body, stdout=out, stderr=err, operation=Operation(attend=attend)) == 0
        ), err.getvalue()
        return out.getvalue().decode().splitlines()

    without = printed(None)
    assert printed(log) == without
    assert printed(None, seed=1) != without, (
        "the sensors have noise, which a reading more would shift"
    )
    rows = list(log.rows())
    assert len(rows) == row_count and {"heading_deg", "pitch_deg"} < rows[-1].keys()


def test_a_front_steered_plan_drives_to_where_it_steers(pybricks_hub: PybricksHub) -> None:
    source = """
steering, drive = Motor(Port.A), Motor(Port.B, Direction.COUNTERCLOCKWISE)
drive.run(500)
steering.run_target(200, ANGLE)
wait(2000)
print(hub.imu.heading())
"""
    headings = []
    for angle in (-20, 0, 20):
        body = find(str(FRONT_STEERED)).make_body()
        assert isinstance(body, MujocoBody)
        run = pybricks_hub.run(HEAD + source.replace("ANGLE", str(angle)), robot=body)
        assert run.exit_code == 0, run.errors
        assert body.pose().x_m > 0.3
        headings.append(float(run.output))
    assert headings[0] > 15 and abs(headings[1]) < 5 and headings[2] < -15


def test_the_two_wheelers_plan_drives_and_turns(pybricks_hub: PybricksHub) -> None:
    body = find(str(PLANS / "two_wheeler.ldr")).make_body()
    run = pybricks_hub.run(
        f"{HEAD}{BASE}base.straight(300)\nbase.turn(90)\nprint(hub.imu.heading())", robot=body
    )
    assert run.exit_code == 0, run.errors
    assert isinstance(body, MujocoBody)
    assert abs(float(run.output) - 90) < 8 and abs(body.pose().x_m - 0.3) < 0.02


def test_the_walkers_plan_walks(pybricks_hub: PybricksHub) -> None:
    source = """
left = [Motor(port, Direction.COUNTERCLOCKWISE) for port in (Port.D, Port.B)]
right = [Motor(port) for port in (Port.C, Port.A)]
async def trot():
    await multitask(left[1].run_angle(400, -180), right[0].run_angle(400, -180))
    await multitask(*[leg.run_angle(400, -720) for leg in left + right])
run_task(trot())
"""
    body = find(str(PLANS / "walker.ldr")).make_body()
    run = pybricks_hub.run(HEAD + source, robot=body)
    assert run.exit_code == 0, run.errors
    assert isinstance(body, MujocoBody)
    assert body.pose().x_m > 0.08


def test_the_arms_plan_turns_its_joints(pybricks_hub: PybricksHub) -> None:
    source = """
rotation, low = Motor(Port.B, gears=[20, 60]), Motor(Port.D, gears=[12, 36])
rotation.run_target(100, 60)
low.run_target(60, 30)
print(rotation.angle(), low.angle())
"""
    run = pybricks_hub.run(HEAD + source, robot=str(PLANS / "robo_arm.ldr"))
    assert run.exit_code == 0, run.errors
    rotation, low = map(int, run.output.split())
    assert abs(rotation - 60) < 4 and abs(low - 30) < 5
    assert run.log[-1]["B_angle_deg"] == pytest.approx(rotation, abs=1), (
        "at the joint, behind its gears"
    )


def test_a_plan_without_a_hub_is_refused(pybricks_hub: PybricksHub, tmp_path: Path) -> None:
    plan = tmp_path / "wheel.ldr"
    plan.write_text("1 0 0 0 0 1 0 0 0 1 0 0 0 1 3647.dat\n")
    with pytest.raises(DescriptionError, match="has no hub; a robot needs one"):
        pybricks_hub.run("pass", robot=str(plan))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_left_and_right_exchanged_with_the_gyroscope_on_spins(seed: int, tmp_path: Path) -> None:
    """What is unstable shows, as on a robot (pybricks/support#1220), and what is not stays
    straight."""
    source = """
hub.imu.reset_heading(0)
base = DriveBase(FIRST, SECOND, 56, 130)
base.use_gyro(True)
base.straight(900, wait=False)
wait(4000)
print(abs(hub.imu.heading()) > 45, abs(hub.imu.heading()) < 1)
"""
    motors = "Motor(Port.A)", "Motor(Port.E, Direction.COUNTERCLOCKWISE)"

    def printed(first: str, second: str) -> str:
        path, out = tmp_path / "main.py", io.BytesIO()
        path.write_text(HEAD + source.replace("FIRST", first).replace("SECOND", second))
        assert run_file(path, make_body(robots.get("two-wheeler"), seed=seed), stdout=out) == 0
        return out.getvalue().decode().strip()

    assert printed(*motors) == "True False"
    assert printed(*reversed(motors)) == "False True"


DRIVEN = """
from pybricks.messaging import BLERadio
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
radio = BLERadio(observe_channels=[1])
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
while not radio.observe(1):
    wait(10)
base.straight(radio.observe(1))
print(round(base.distance()))
"""
TOLD = """
from pybricks.messaging import BLERadio
from pybricks.tools import wait
BLERadio(broadcast_channel=1).broadcast(120)
wait(3000)
"""


def test_robots_of_several_programs_share_a_world(pybricks_hub: PybricksHub) -> None:
    told, driven = pybricks_hub.run_together(TOLD, DRIVEN, robots=["scout", "two-wheeler"])
    assert (told.exit_code, driven.exit_code, driven.errors) == (0, 0, "")
    assert abs(int(driven.output) - 120) <= 2
    # Its motors have really turned: 120 mm are 245 degrees of a wheel of 56 mm.
    assert 240 < float(driven.log[-1]["A_angle_deg"] or 0.0) < 252
    with pytest.raises(DescriptionError, match="1 robot for 2 programs; name one for each"):
        pybricks_hub.run_together(TOLD, DRIVEN, robots=["scout"])
    with pytest.raises(DescriptionError, match="a bench has no body to share a world"):
        pybricks_hub.run_together(TOLD, DRIVEN, robots=["scout", "bench"])
    for wrong in ("scout", ["scout", None]):
        with pytest.raises(DescriptionError, match="give a list of names, such as"):
            pybricks_hub.run_together(TOLD, DRIVEN, robots=wrong)  # type: ignore[list-item,arg-type]
