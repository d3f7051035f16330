"""Robots as they are drawn: names, directions, drive base, pairs, ports and facing of plans."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.errors import PlanError
from brickhub.robot import Direction, DriveBase, Sense
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.robots import EV3_DRIVER, TWO_WHEELER, as_drawn, plans
from bricktwin.robots.as_drawn import DrawnMotor, robot_as_drawn
from bricktwin.robots.plan_facts import DeviceFacts
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

PLANS = Path(plans.__path__[0])
EXAMPLES = Path(__file__).parents[4] / "examples"
TURNS = {
    "as ours": "1 0 0 0 1 0 0 0 1",
    "to the right": "0 0 1 0 1 0 -1 0 0",
    "to the left": "0 0 -1 0 1 0 1 0 0",
    "towards the viewer": "-1 0 0 0 1 0 0 0 -1",
}
"""Rotations of a drawing about its upright axis, as LDraw writes them."""


def as_strangers_draw(folder: Path, name: str, turn: str = "as ours") -> Path:
    """One of our plans without any mark of ours, turned."""
    lines = (PLANS / f"{name}.ldr").read_text(encoding="utf-8").splitlines()
    own = [line for line in lines if "!BRICKSRL" not in line]
    first = own[0].removeprefix("0 FILE ")
    path = folder / "drawing.mpd"
    head = ["0 FILE main.ldr", f"1 16 0 0 0 {TURNS[turn]} {first}"]
    path.write_text("\n".join([*head, *own]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "ours"), [("two_wheeler", TWO_WHEELER), ("ev3_driver", EV3_DRIVER)]
)
def test_our_driving_robots_are_understood_from_their_plans(name, ours):
    drawn = robot_as_drawn(PLANS / f"{name}.ldr")
    assert drawn.is_wired
    assert drawn.robot.drive_base == ours.drive_base
    assert drawn.robot.needs_imu == ours.needs_imu
    assert set(drawn.robot.mirrored) >= set(ours.mirrored)
    ports = {sensor.name: sensor.port for sensor in drawn.robot.sensors}
    assert ports == {sensor.name: sensor.port for sensor in ours.sensors}
    for motor in ours.motors:
        assert drawn.robot.motor(motor.name) == motor


def test_roles_follow_from_what_moves():
    roles = {}
    for path in (PLANS / "robo_arm.ldr", EXAMPLES / "13_front_steered.ldr"):
        for motor in robot_as_drawn(path).motors:
            roles[motor.name] = motor.role
    assert roles == {
        "low": Role.JOINT,
        "rotation": Role.JOINT,
        "high": Role.JOINT,
        "grab": Role.JOINT,
        "steering": Role.STEERING,
        "drive": Role.WHEEL,
    }


def test_joint_keeps_within_its_way():
    arm = robot_as_drawn(PLANS / "robo_arm.ldr").robot
    assert arm.motor("low").range_deg is not None
    assert arm.motor("rotation").range_deg is None


def test_six_legs_are_named_and_paired_by_their_places():
    drawn = robot_as_drawn(EXAMPLES / "15_six_legs.ldr")
    rows = ("front", "middle", "back")
    assert {motor.name for motor in drawn.motors_with(Role.LEG)} == {
        f"{side}_{row}" for side in ("left", "right") for row in rows
    }
    assert set(drawn.robot.mirrored) == {(f"left_{row}", f"right_{row}") for row in rows}
    # The shafts of both sides look outwards, so they walk forwards in opposite directions.
    sides = {motor.name.partition("_")[0]: motor.direction for motor in drawn.robot.motors}
    assert sides == {"left": Direction.CLOCKWISE, "right": Direction.COUNTERCLOCKWISE}


@pytest.mark.parametrize("turn", TURNS)
def test_drawing_without_marks_is_wired_and_faces_what_its_sensor_sees(tmp_path, turn):
    path = as_strangers_draw(tmp_path, "ev3_driver", turn)
    drawn = robot_as_drawn(path)
    assert not drawn.is_wired
    assert sorted(motor.port for motor in drawn.robot.motors) == ["A", "B"]
    assert sorted(sensor.port for sensor in drawn.robot.sensors) == ["1", "2", "3", "4"]
    # The one on the left is on the left, however the drawing is turned.
    assert drawn.robot.drive_base is not None
    assert drawn.robot.drive_base.left == "left"
    assert drawn.sensor_looking(Sense.DISTANCE, "ahead") == "eyes"
    body = MujocoBody(drawn.robot, OPEN_FLOOR, Physics(), 0)
    ahead_mm, _, above_mm = body.sensor_place_mm("light")
    assert ahead_mm == pytest.approx(64, abs=1)
    assert 5 < above_mm < 24


def test_hub_without_enough_ports_is_refused_with_the_line(tmp_path):
    text = as_strangers_draw(tmp_path, "ev3_driver").read_text(encoding="utf-8")
    motor = next(line for line in text.splitlines() if line.endswith(" 95658.dat"))
    path = tmp_path / "many.mpd"
    # They are added to the main model, before the first line of the next one.
    lines = text.splitlines()
    path.write_text("\n".join([*lines[:2], *[motor] * 3, *lines[2:]]) + "\n", encoding="utf-8")
    with pytest.raises(
        PlanError, match=r"line \d+: no port of the EV3 brick .* is left for EV3 large motor"
    ):
        robot_as_drawn(path)


def test_what_has_no_twin_is_named(tmp_path):
    path = as_strangers_draw(tmp_path, "two_wheeler")
    lines = path.read_text(encoding="utf-8").splitlines()
    gears = [f"1 7 {x} -200 0 1 0 0 0 1 0 0 0 1 3648b.dat" for x in (0, 64)]
    chain = ["0 SYNTH BEGIN TECHNIC_CHAIN_LINK 0", "0 SYNTH END"]
    unknown_part = "1 7 0 -300 0 1 0 0 0 1 0 0 0 1 54321.dat"
    tread = "1 0 0 -400 0 1 0 0 0 1 0 0 0 1 3873.dat"
    lines[2:2] = [*gears, unknown_part, *chain, tread]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    unknown, undrawn, treads, gears_apart = robot_as_drawn(path).lacks
    assert undrawn.startswith("line 6: LSynth has not drawn the parts of this technic_chain_link")
    assert treads.startswith("line 8: Chain link with a tread (3873) turns gears, but drives no")
    assert "part 54321 is not in the catalogue" in unknown
    assert "as they are 1.6 mm too far apart; move one" in gears_apart


def motor(port: str = "A", **facts: object) -> DeviceFacts:
    """A motor of a drawing."""
    made = {"name": "spike-medium", "part": "motor", "line": 1, "port": port, "label": None}
    made |= {"sides": (), "stops_deg": (), "gears": (), "ratio": 1.0, "axis": (0.0, 1.0, 0.0)}
    return DeviceFacts(**{**made, **facts})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("facts", "range_deg"),
    [
        # Five degrees before both ends.
        ({"way_deg": (-40.0, 100.0)}, (-35, 95)),
        ({"way_deg": (-40.5, 100.5)}, (-35, 95)),
        # What the plan says comes before what its parts meet.
        ({"way_deg": (-40.0, 100.0), "stops_deg": (-20.0, 60.0)}, (-15, 55)),
        # Within half a turn of the shaft on both sides.
        ({"way_deg": (-250.0, 100.0)}, (-175, 95)),
        ({"way_deg": (-40.0, 250.0)}, (-35, 175)),
        # Gears of 1 to 3: a third of the way of the shaft, and of its turn.
        ({"way_deg": (-120.0, 150.0), "gears": (12, 36)}, (-35, 45)),
        ({"way_deg": (-300.0, 300.0), "gears": (12, 36)}, (-55, 55)),
        # Counted the other way round.
        ({"way_deg": (-40.0, 100.0), "is_forward": False}, (-95, 35)),
        # Less than 20 degrees are no way.
        ({"way_deg": (0.0, 30.0)}, (5, 25)),
        ({"way_deg": (0.0, 29.0)}, None),
        ({}, None),
        ({"way_deg": (-40.0, 100.0), "role": Role.LEG}, None),
    ],
)
def test_a_joint_turns_within_its_way_and_half_a_turn(facts, range_deg):
    drawn = DrawnMotor("arm", motor(**{"role": Role.JOINT, **facts}), "")
    described = as_drawn._described(drawn)
    assert described.range_deg == range_deg
    assert described.direction is (
        Direction.CLOCKWISE if drawn.facts.is_forward else Direction.COUNTERCLOCKWISE
    )
    assert (described.name, described.port, described.gears) == ("arm", "A", drawn.facts.gears)


@pytest.mark.parametrize(
    ("facts", "place", "words"),
    [
        ({"role": "wheel", "wheel_mm": 56.0}, "left front", "turns a wheel of 56 mm, left front"),
        ({"role": "wheel", "wheel_mm": 43.2}, "", "turns a wheel of 43.2 mm"),
        ({"role": "leg"}, "right", "turns a leg, right"),
        ({"role": "steering"}, "", "steers"),
        ({"role": "joint", "way_deg": (-40.2, 99.8)}, "", "turns a joint, from -40 to 100°"),
        (
            {"role": "joint", "way_deg": (-40.0, 100.0), "stops_deg": (0.0, 50.0)},
            "",
            "turns a joint, from 0 to 50°",
        ),
        ({"role": "joint"}, "", "turns something all around that reaches no floor"),
        ({"role": "wheel", "turns_with": "B"}, "left", "turns with port B"),
        ({}, "", "turns nothing"),
    ],
)
def test_what_a_motor_moves_is_said_in_words(facts, place, words):
    assert DrawnMotor("m", motor(**facts), place).moves == words


def wheel(port: str, ahead_m: float, left_m: float, **facts: object) -> DeviceFacts:
    made = {"role": Role.WHEEL, "at_m": (ahead_m, left_m, 0.03), "wheel_left_m": left_m}
    return motor(port, **{**made, "wheel_mm": 56.0, **facts})


LEFT = wheel("A", 0.0, 0.05, axis=(0.0, 1.0, 0.0))
RIGHT = wheel("B", 0.0, -0.05, axis=(0.0, -1.0, 0.0))


@pytest.mark.parametrize(
    ("motors", "names"),
    [
        ([LEFT, RIGHT], ["left", "right"]),
        # To the left of the middle of all of them, wherever that is.
        ([wheel("A", 0.0, 0.09), wheel("B", 0.0, 0.01)], ["left", "right"]),
        ([LEFT], ["drive"]),
        ([LEFT, RIGHT, motor("C", role=Role.STEERING)], ["left", "right", "steering"]),
        ([LEFT, RIGHT, motor("C", role=Role.JOINT)], ["left", "right", "motor_c"]),
        # Rows are more than a centimetre apart.
        (
            [
                wheel("A", 0.0, 0.05),
                wheel("B", 0.1, 0.05),
                wheel("C", 0.09, -0.05),
                wheel("D", 0.01, -0.05),
            ],
            ["left_back", "left_front", "right_front", "right_back"],
        ),
        # Four rows have no names, and two motors at one place neither.
        ([wheel(port, 0.05 * row, 0.0) for row, port in enumerate("ABCD")], None),
        ([LEFT, RIGHT, wheel("C", 0.0, 0.06)], ["motor_a", "right", "motor_c"]),
        # The plan's own names come first, and are given once.
        ([LEFT._replace(label="right"), RIGHT], ["right", "motor_b"]),
        # What turns with another is in no place of its own.
        ([LEFT, RIGHT, wheel("C", 0.1, 0.05, turns_with="A")], ["left", "right", "motor_c"]),
    ],
)
def test_motors_are_named_by_their_places(motors, names):
    places = {one.port: place for one, place in as_drawn._places(motors)}
    wanted = names or [f"motor_{one.port.lower()}" for one in motors]
    assert as_drawn._motor_names(motors, places) == wanted


def drawn_of(*motors: DeviceFacts) -> list[DrawnMotor]:
    return [DrawnMotor(f"m_{one.port}", one, "") for one in motors]


@pytest.mark.parametrize(
    ("right", "has_base"),
    [
        ({}, True),
        ({"at_m": (0.003, -0.05, 0.03)}, True),
        ({"at_m": (0.005, -0.05, 0.03)}, False),
        ({"at_m": (0.0, -0.05, 0.033)}, True),
        ({"at_m": (0.0, -0.05, 0.035)}, False),
        ({"at_m": (0.0, 0.047, 0.03)}, False),
        ({"axis": (0.8, -0.6, 0.0)}, False),
        ({"gears": (12, 20)}, False),
        ({"name": "spike-large"}, False),
        ({"wheel_mm": 43.2}, False),
        ({"role": Role.LEG}, False),
        ({"turns_with": "A"}, False),
    ],
)
def test_two_wheels_alike_on_one_axle_are_a_drive_base(right, has_base):
    for order in ((LEFT, RIGHT._replace(**right)), (RIGHT._replace(**right), LEFT)):
        base = as_drawn._drive_base(drawn_of(*order))
        assert base == (DriveBase("m_A", "m_B") if has_base else None)
    assert as_drawn._drive_base(drawn_of(LEFT)) is None
    third = wheel("C", 0.1, 0.0)
    assert as_drawn._drive_base(drawn_of(LEFT, RIGHT, third)) is None


def test_pairs_of_a_mirror_begin_on_the_left_and_take_each_motor_once():
    front = [
        one._replace(port=port, at_m=(0.1, *one.at_m[1:]))
        for one, port in zip((RIGHT, LEFT), "CD", strict=True)
    ]
    pairs = as_drawn._mirrored(drawn_of(RIGHT, *front, LEFT))
    assert set(pairs) == {("m_A", "m_B"), ("m_D", "m_C")}
    # One-sided motors look outwards on both sides; two-sided ones are mounted alike.
    alike = RIGHT._replace(axis=(0.0, 1.0, 0.0))
    assert list(as_drawn._mirrored(drawn_of(LEFT, alike))) == []
    large = [one._replace(name="ev3-large") for one in (LEFT, RIGHT, alike)]
    assert list(as_drawn._mirrored(drawn_of(large[0], large[1]))) == []
    assert list(as_drawn._mirrored(drawn_of(large[0], large[2]))) == [("m_A", "m_B")]


def test_sensors_are_named_by_what_they_see_as_far_as_that_is_one():
    def sensor(port: str, name: str, looks: str, label: str | None = None) -> DeviceFacts:
        return motor(port, name=name, looks=looks, label=label)

    sensors = [
        sensor("C", "UltrasonicSensor", "ahead"),
        sensor("D", "ColorSensor", "down"),
        sensor("E", "UltrasonicSensor", "ahead"),
        sensor("F", "ColorSensor", "ahead"),
        sensor("A", "ColorSensor", "down", "line"),
        sensor("B", "UltrasonicSensor", "left"),
    ]
    wanted = ["eyes", "light", "sensor_e", "sensor_f", "line", "sensor_b"]
    assert as_drawn._sensor_names(sensors, taken=["left"]) == wanted
    assert as_drawn._sensor_names(sensors[:2], taken=["eyes"]) == ["sensor_c", "light"]
