"""Survey programs on the virtual hub and over the simulated radio."""

from __future__ import annotations

import dataclasses

import pytest
from bench_arm import START_DEG, BenchArm
from ble_world import World, bounded
from described import ROBO_ARM, TWO_WHEELER, WALKER
from hub_programs import unplug
from on_a_body import ArmContract, check_survey

from brickhub.errors import HubError, HubProgramError, HubTimeoutError
from brickhub.hub.diagnostics.survey import (
    STALL_LIMIT_DEG,
    find_stops,
    parse_survey,
    run,
    stops_program,
    survey,
    survey_program,
)
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.transport import HubProgram
from brickhub.robot import BENCH, Direction, HubKind, Motor, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.virtual_transport import VirtualHub

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize("hub", [HubKind.PRIME, HubKind.ESSENTIAL, HubKind.TECHNIC, HubKind.CITY])
def test_survey_programs_fit_every_hub(hub: HubKind) -> None:
    robot = Robot(
        "any", hub, (Motor("one", "A", gears=(12, 20)), Motor("two", "B", range_deg=(0, 90)))
    )
    for program in (survey_program(robot), stops_program(robot)):
        run(VirtualHub(BenchBody(robot)), program, 60.0)
        program_blob(compile_program(program), hub)


@pytest.mark.parametrize(
    "robot", [TWO_WHEELER, WALKER, ROBO_ARM, BENCH], ids=lambda robot: robot.name
)
def test_survey_finds_devices_without_motion(robot: Robot) -> None:
    check_survey(BenchBody(robot))


def test_survey_angle_has_described_direction() -> None:
    hub = VirtualHub(BenchArm())
    assert survey(hub, ROBO_ARM).angles_deg["high"] == -70
    turned = dataclasses.replace(ROBO_ARM.motor("high"), direction=Direction.COUNTERCLOCKWISE)
    other = dataclasses.replace(ROBO_ARM, motors=(turned,))
    assert survey(hub, other).angles_deg == {"high": 70}


def test_survey_tolerates_missing_device() -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    unplug(hub.machine, "A")
    found = survey(hub, TWO_WHEELER)
    assert found.ports["A"] == 0 and found.ports["E"] == 48
    assert set(found.angles_deg) == {"left"}


class TestArmOnTheBench(ArmContract):
    """An arm whose joints carry nothing, between their end stops."""

    start_deg = START_DEG

    def arm(self) -> Body:
        return BenchArm()


def test_unblocked_joint_gives_up() -> None:
    robot = Robot("free", HubKind.PRIME, (Motor("one", "A", range_deg=(0, 90)),))
    hub = VirtualHub(BenchBody(robot))
    assert find_stops(hub, robot) == {"one": None}
    assert abs(hub.body.angle_mdeg("A")) < 1000 * (STALL_LIMIT_DEG + 50)


def test_a_robot_without_joints_does_not_move() -> None:
    assert find_stops(VirtualHub(BenchBody(TWO_WHEELER)), TWO_WHEELER) == {}


@pytest.mark.parametrize(
    "lines", [[], ["{'ports': {"], ["{'ports': {'A': 48}, 'name': 'n'}"], ["8000"]]
)
def test_incomplete_answer_raises(lines: list[str]) -> None:
    with pytest.raises(HubError, match="incomplete; bring it near"):
        parse_survey(lines)


@pytest.mark.parametrize(
    ("source", "error", "says"),
    [
        ("print('x')\n1 / 0\n", HubProgramError, "ZeroDivisionError at|raised ZeroDivisionError"),
        (
            "from pybricks.tools import wait\nwhile True:\n    wait(100)\n",
            HubTimeoutError,
            "did not end within 3 s",
        ),
        ("print('x')\n", HubError, "did not end within 3 s"),
    ],
)
def test_failing_programs(source: str, error: type[HubError], says: str) -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    with pytest.raises(error, match=says):
        run(hub, HubProgram(source, 1), 3.0)
    assert not any(servo.is_open for servo in hub.machine.servos.values())


def test_survey_twice_over_bluetooth_downloads_once(world: World) -> None:
    world.hub.library.append(survey_program(TWO_WHEELER).source)
    transport = world.transport()
    transport.open()
    for _ in range(2):
        found = survey(transport, TWO_WHEELER)
        assert found.ports["A"] == found.ports["E"] == 48 and found.ports["C"] == 62
    assert world.hub.commands.count(3) == 2, "one download"
    world.hub.library.append("from pybricks.tools import wait\nwhile True:\n    wait(10)\n")
    bounded(lambda: run(transport, HubProgram(world.hub.library[-1], 7), 0.5), HubTimeoutError, 6.0)
    assert not world.hub.is_running


def test_survey_angle_is_that_behind_the_gears() -> None:
    hub = VirtualHub(BenchArm())
    shaft_deg = -70.0 * 360.0 / ROBO_ARM.motor("high").turn_deg
    for gears in ((), (12, 36), (20, 12, 16)):
        geared = dataclasses.replace(ROBO_ARM.motor("high"), gears=gears, range_deg=None)
        found = survey(hub, dataclasses.replace(ROBO_ARM, motors=(geared,)))
        wanted_deg = shaft_deg * geared.turn_deg / 360.0
        assert found.angles_deg["high"] == pytest.approx(wanted_deg, abs=1)


@pytest.mark.parametrize(
    ("sides", "tilt_deg"),
    [
        ((), (0, 0)),
        # A hub on the bench lies on its back: this robot looks up, that one lies on its right.
        (("ahead", "down"), (-90, 0)),
        (("left", "up"), (0, 90)),
    ],
)
def test_survey_programs_know_how_the_hub_is_mounted(
    sides: tuple[str, ...], tilt_deg: tuple[int, int]
) -> None:
    robot = dataclasses.replace(TWO_WHEELER, needs_imu=True, hub_sides=sides)
    source = survey_program(robot).source
    assert ("import Axis, Direction, Port" in source) is bool(sides)
    assert ("Axis." in source) is bool(sides)
    found = survey(VirtualHub(BenchBody(robot)), robot)
    assert (found.pitch_deg, found.roll_deg) == tilt_deg
