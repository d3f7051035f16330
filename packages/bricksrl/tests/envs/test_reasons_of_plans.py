"""What drawn robots can learn, and why not: the words, and the numbers of their tasks."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from brickhub.hub.interface import RunAngle, UntilDone, Wait, WheelsAngle, WheelsSpeed
from brickhub.robot import HubKind, Sense
from bricksrl.envs import get_task
from bricksrl.envs.abilities import balancing, driving, of_plans, reaching
from bricksrl.envs.abilities.of_plans import ABILITIES, ability_of, offers
from bricksrl.errors import DescriptionError, UnknownNameError
from bricktwin.robots import plans
from bricktwin.robots.as_drawn import DrawnMotor, DrawnRobot, robot_as_drawn
from bricktwin.twin.objects import Line

PLANS = Path(plans.__path__[0])
EXAMPLES = Path(__file__).parents[4] / "examples"
ROVER = EXAMPLES / "drawings" / "rover.ldr"
BALANCER = EXAMPLES / "drawings" / "balancer.ldr"

NO_WHEEL = "no motor turns a wheel"
NO_PAIR = "it has {} driven wheels, but needs one on the left and one on the right"
NO_JOINT = "no motor turns a joint with an end"
NO_AXLE = "it has no two driven wheels on one axle"
ON_ONE_AXLE = "it stands on one axle alone; add a caster"
REASONS = {
    PLANS / "two_wheeler.ldr": {
        "walk": "it drives on wheels",
        "upright": "it stands by itself",
        "line": "no color sensor looks down at a line",
        "ahead": "its drive base does that without learning",
        "reach": NO_JOINT,
    },
    EXAMPLES / "drawings" / "crane.ldr": {
        "walk": "no motor turns what reaches the floor",
        "upright": NO_AXLE,
        "stop": NO_WHEEL,
        "away": "no distance sensor looks ahead",
        "spin": NO_WHEEL,
        "line": NO_WHEEL,
        "park": NO_WHEEL,
        "ahead": NO_WHEEL,
    },
    EXAMPLES / "drawings" / "quad.ldr": {
        "walk": "it drives on wheels",
        "upright": NO_AXLE,
        "stop": NO_PAIR.format(4),
        "away": "no distance sensor looks ahead",
        "spin": NO_PAIR.format(4),
        "line": NO_PAIR.format(4),
        "park": NO_PAIR.format(4),
        "reach": NO_JOINT,
    },
    EXAMPLES / "drawings" / "pusher.ldr": {
        "walk": "it drives on wheels",
        "upright": "it stands by itself",
        "spin": "nothing measures its turns; add a gyro sensor",
        "line": "no color sensor looks down at a line",
        "ahead": "its drive base does that without learning",
        "reach": NO_JOINT,
    },
    BALANCER: {
        "walk": "it drives on wheels",
        "stop": ON_ONE_AXLE,
        "away": "no distance sensor looks ahead",
        "spin": ON_ONE_AXLE,
        "line": ON_ONE_AXLE,
        "park": ON_ONE_AXLE,
        "ahead": "its drive base does that without learning",
        "reach": NO_JOINT,
    },
}


@pytest.mark.parametrize("path", REASONS, ids=lambda path: path.stem)
def test_what_a_robot_lacks_is_said_of_each_ability(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Their bodies take seconds to make, and are made in the tests of abilities.
    monkeypatch.setattr(of_plans, "make_body", lambda _robot: None)
    found = {}
    for offer in offers(robot_as_drawn(path)):
        assert offer.remark == ""
        if offer.task is None:
            found[offer.ability.name] = offer.reason
    assert found == REASONS[path]


def without_imu(drawn: DrawnRobot, hub: HubKind) -> DrawnRobot:
    """The robot with another hub, whose gyroscope is not used."""
    robot = replace(drawn.robot, hub=hub, needs_imu=False, hub_sides=("up", "ahead"))
    return replace(drawn, robot=robot)


@pytest.mark.parametrize(
    ("hub", "remedy"),
    [(HubKind.PRIME, "put the hub in straight"), (HubKind.CITY, "take a hub that has one")],
)
def test_who_balances_needs_a_gyroscope(hub: HubKind, remedy: str) -> None:
    drawn = robot_as_drawn(BALANCER)
    # A City hub has two ports, for the two motors.
    drawn = replace(drawn, robot=replace(drawn.robot, sensors=()))
    with pytest.raises(DescriptionError) as caught:
        balancing.keep_upright(without_imu(drawn, hub))
    assert str(caught.value) == f"no gyroscope measures how it leans; {remedy}"


@pytest.mark.parametrize(
    ("lean_deg", "says"),
    [
        (15.0, ""),
        (-15.0, ""),
        (15.5, "its centre of mass is too far behind its axle: it is in balance at 16 degrees"),
        (-40.2, "its centre of mass is too far in front of its axle: it is in balance at 40 deg"),
    ],
)
def test_who_balances_has_its_mass_above_its_axle(
    monkeypatch: pytest.MonkeyPatch, lean_deg: float, says: str
) -> None:
    monkeypatch.setattr(balancing, "lean_on_one_axle_deg", lambda _robot: lean_deg)
    drawn = robot_as_drawn(BALANCER)
    if says:
        with pytest.raises(DescriptionError, match=says) as caught:
            balancing.keep_upright(drawn)
        assert str(caught.value).endswith("; move the hub until it is above the wheels")
        return
    task = balancing.keep_upright(drawn)
    # A hand holds it within a degree of its balance until its motors turn.
    assert task.scene.held_deg == (lean_deg - 1.0, lean_deg + 1.0)


def test_a_balance_is_five_seconds_of_two_wheels_that_are_steered_by_their_duty() -> None:
    task = get_task(f"{BALANCER}:upright")
    assert [command.motor for command in task.interface.commands] == ["left", "right"]
    assert [(command.low, command.high) for command in task.interface.commands] == [(-100, 100)] * 2
    assert task.interface.settle == Wait(20) and task.max_steps == 250
    names = [channel.name for channel in task.interface.channels]
    assert names[:2] == ["pitch", "pitch_rate"]
    assert task.interface.channels[2:] == (
        WheelsAngle("left", "right"),
        WheelsSpeed("left", "right"),
    )
    assert task.settings == {
        "structure": "upright",
        "trial_steps": 250,
        "settle_steps": 0,
        "falls_late": True,
        "tilt_deg": 35.0,
    }


def test_who_cannot_measure_its_turns_does_not_spin() -> None:
    with pytest.raises(DescriptionError) as caught:
        driving.spin(without_imu(robot_as_drawn(ROVER), HubKind.PRIME))
    assert str(caught.value) == "nothing measures its turns; put the hub in straight"


@pytest.mark.parametrize(("above_mm", "sees"), [(24.0, True), (24.1, False), (31.0, False)])
def test_a_color_sensor_sees_a_line_from_24_mm_at_most(
    monkeypatch: pytest.MonkeyPatch, above_mm: float, sees: bool
) -> None:
    monkeypatch.setattr(driving, "_place_mm", lambda _drawn, _sensor: (40.0, -3.0, above_mm))
    drawn = robot_as_drawn(ROVER)
    if sees:
        scene = driving.follow_line(drawn).scene
        # The sensor, 40 mm ahead and 3 mm to the right, starts at the edge within 5 and 2 mm.
        assert scene.start_mm == ((-45.0, -35.0), (1.0, 5.0))
        return
    with pytest.raises(DescriptionError) as caught:
        driving.follow_line(drawn)
    light = drawn.sensor_looking(Sense.SURFACE, "down")
    assert str(caught.value) == (
        f"its color sensor '{light}' is {above_mm:.0f} mm above the floor, too high to see a "
        "line; let it look from 24 mm or less"
    )


def test_a_line_is_turned_round_for_who_drives_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = robot_as_drawn(ROVER)
    scenes = []
    for ahead_mm in (40.0, -40.0):
        monkeypatch.setattr(driving, "_place_mm", lambda *_, mm=ahead_mm: (mm, 0.0, 8.0))
        task = driving.follow_line(drawn)
        scenes.append(task.scene)
        assert task.doc == (
            "rover follows the left edge of a black line, clockwise"
            f"{', backwards' if ahead_mm < 0 else ''}."
        )
        assert task.settings == {"structure": "edge", "trial_steps": 100, "settle_steps": 0}
    (ahead,), (back,) = (scene.objects for scene in scenes)
    assert isinstance(ahead, Line) and isinstance(back, Line)
    for (x_mm, y_mm), (back_x_mm, back_y_mm) in zip(ahead.points_mm, back.points_mm, strict=True):
        assert (back_x_mm, back_y_mm) == (-x_mm, -y_mm)


@pytest.mark.parametrize(
    ("ahead_mm", "above_mm", "says"),
    [
        (
            -7.9,
            8.0,
            (
                "hard, as its color sensor is 8 mm behind its wheels, where turns hardly move it; "
                "put it 20 to 100 mm ahead of them"
            ),
        ),
        (8.0, 8.0, ""),
        (
            -8.0,
            8.0,
            (
                "backwards, as its color sensor is 8 mm behind its wheels; put it ahead of them to "
                "see it drive forwards"
            ),
        ),
    ],
)
def test_remarks_on_the_place_of_a_color_sensor(
    monkeypatch: pytest.MonkeyPatch, ahead_mm: float, above_mm: float, says: str
) -> None:
    monkeypatch.setattr(driving, "_place_mm", lambda *_: (ahead_mm, 0.0, above_mm))
    assert driving.remark_on_line(robot_as_drawn(ROVER)) == says


def test_a_color_sensor_is_too_far_ahead_where_3_degrees_take_it_off_the_edge(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(driving, "spot_mm", lambda above_mm: 0.5 * above_mm)
    farthest_mm = 5.0 / math.tan(math.radians(3.0))  # 95.4
    drawn = robot_as_drawn(ROVER)
    said = []
    for ahead_mm in (farthest_mm - 0.1, farthest_mm + 0.1):
        monkeypatch.setattr(driving, "_place_mm", lambda *_, mm=ahead_mm: (mm, 0.0, 10.0))
        said.append(driving.remark_on_line(drawn))
    assert said == [
        "",
        (
            "hard, as its color sensor is 96 mm ahead of its wheels and 10 mm above the floor, "
            "where small turns take it off the edge; put it at most 95 mm ahead of them, or higher"
        ),
    ]


def geared(motor: DrawnMotor, ratio: float, gears: tuple[int, ...]) -> DrawnMotor:
    return replace(motor, facts=motor.facts._replace(ratio=ratio, gears=gears))


@pytest.mark.parametrize(
    ("ratio", "gears", "turns"),
    [(1.0, (), 1.0), (3.0, (), 1 / 3), (3.0, (12, 36), 1.0), (0.0, (), 1.0)],
)
def test_wheels_without_a_drive_base_drive_100_mm_in_a_step(
    ratio: float, gears: tuple[int, ...], turns: float
) -> None:
    """A motor's own gears are known to its hub; a differential after it is not."""
    drawn = robot_as_drawn(ROVER)
    motors = tuple(geared(motor, ratio, gears) for motor in drawn.motors)
    bare = replace(drawn, motors=motors, robot=replace(drawn.robot, drive_base=None))
    task = driving.drive_away(bare)
    # Wheels of 87.8 mm roll 275.8 mm in a turn.
    turn_deg = turns * 130.5143
    commands = task.interface.commands
    assert [type(command) for command in commands] == [RunAngle, RunAngle]
    assert [command.name for command in commands] == ["right", "left"]
    for command in commands:
        assert (command.low, command.high) == pytest.approx((-turn_deg, turn_deg), rel=1e-5)
        assert command.speed_deg_s == 500
    assert [channel.name for channel in task.interface.channels][:2] == [
        "right_angle",
        "left_angle",
    ]
    assert task.interface.settle == UntilDone()
    assert task.id == "Away-v0"


@pytest.mark.parametrize(
    ("count", "says"),
    [
        (0, NO_WHEEL),
        (1, "it has 1 driven wheel, but needs one on the left and one on the right"),
        (2, "its two driven wheels are not alike on both sides of one axle"),
        (3, "it has 3 driven wheels, but needs one on the left and one on the right"),
    ],
)
def test_wheels_that_are_no_drive_base_are_counted(count: int, says: str) -> None:
    drawn = robot_as_drawn(EXAMPLES / "drawings" / "quad.ldr")
    few = replace(drawn, motors=drawn.motors[:count])
    with pytest.raises(DescriptionError) as caught:
        driving.park(few)
    assert str(caught.value) == says


def test_a_reach_ends_where_each_joint_is_within_5_degrees_on_average() -> None:
    task = reaching.reach(robot_as_drawn(PLANS / "robo_arm.ldr"))
    assert [entry.name for entry in task.entries] == [
        *("low_angle", "rotation_angle", "high_angle", "grab_angle"),
        *("low_goal", "rotation_goal", "high_goal", "grab_goal"),
    ]
    ranges = [(entry.low, entry.high, entry.wraps) for entry in task.entries]
    assert ranges[:4] == ranges[4:] and ranges[0][1] > 20.0
    assert ranges[1] == ranges[3] == (0.0, 360.0, True)
    assert (task.max_steps, task.interface.settle) == (50, Wait(250))
    for command in task.interface.commands:
        assert isinstance(command, RunAngle)
        assert (command.low, command.high, command.speed_deg_s) == (-30.0, 30.0, 250)
    start = [10.0, 350.0, -20.0, 90.0]
    # Errors of 7, 10 (the shorter way around), 2 and 0.9 degrees; then a tenth more.
    near = torch.tensor([[*start, 3.0, 0.0, -18.0, 90.9]])
    at = torch.tensor([[*start, 3.0, 0.0, -18.0, 91.0]])
    reward = task.reward(near, torch.zeros(1, 4), at)
    assert reward.tolist() == [[pytest.approx(-0.2)]]
    assert task.terminated(near).tolist() == [[True]]
    assert task.terminated(at).tolist() == [[False]]
    assert bool(task.success(torch.stack((at[0], near[0]))))
    assert not bool(task.success(torch.stack((near[0], at[0]))))
    sums = task.metrics(torch.stack((near[0], at[0])))["error_sum_deg"]
    assert sums.item() == pytest.approx(20.0)


def test_a_stop_is_learned_in_approaches_of_four_seconds() -> None:
    task = get_task(f"{PLANS / 'two_wheeler.ldr'}:stop")
    (command,) = task.interface.commands
    (eye,) = task.interface.channels
    assert (command.low, command.high, eye.low, eye.high) == (-300, 300, 0.0, 1000.0)
    assert (task.interface.settle, task.max_steps) == (Wait(100), 40)
    assert task.settings == {"structure": "approach", "trial_steps": 40, "settle_steps": 0}
    assert task.scene.wall_distance_mm == (500.0, 700.0)
    assert task.scene.heading_deg == (-5.0, 5.0)
    seen = torch.tensor([[100.0], [199.9], [200.0]])
    assert task.reward(seen, torch.zeros(3, 1), seen)[:, 0].tolist() == pytest.approx(
        [math.exp(-0.75), math.exp(-0.2495), math.exp(-0.25)]
    )
    ends = [
        bool(task.success(torch.tensor([[150.0], [mm]]))) for mm in (100.0, 100.1, 199.9, 200.0)
    ]
    assert ends == [False, True, True, False]


def test_who_walks_takes_steps_of_100_degrees_in_a_quarter_of_a_second() -> None:
    task = get_task(f"{PLANS / 'walker.ldr'}:walk")
    for command in task.interface.commands:
        assert isinstance(command, RunAngle)
        assert (command.low, command.high, command.speed_deg_s) == (-100.0, 100.0, 600)
    assert (task.interface.settle, task.max_steps) == (Wait(250), 100)
    assert task.walks and task.symmetric
    forward = task.entries[-1]
    assert (forward.name, forward.unit, forward.low, forward.high) == (
        "forward",
        "mm",
        -100.0,
        100.0,
    )
    assert forward.bounds == (-32767.0, 32767.0)


def test_abilities_come_in_the_order_of_their_time_with_what_learns_them() -> None:
    found = [(name, one.agent, one.episodes) for name, one in ABILITIES.items()]
    assert found == [
        ("walk", "gait", 3),
        ("upright", "gait", 30),
        ("stop", "gait", 40),
        ("away", "sac", 20),
        ("spin", "sac", 15),
        ("line", "gait", 30),
        ("park", "sac", 60),
        ("ahead", "gait", 2),
        ("reach", "sac", 100),
    ]


def test_a_reference_names_what_a_robot_learns() -> None:
    assert ability_of("my.rover.ldr:walk") is ABILITIES["walk"]
    names = "walk, upright, stop, away, spin, line, park, ahead, reach"
    with pytest.raises(UnknownNameError) as caught:
        ability_of("rover.ldr")
    assert str(caught.value) == (
        "rover.ldr is a plan; name what its robot is to learn, such as rover.ldr:walk "
        f"({names}): `bricksrl learn rover.ldr --look` says what it can"
    )
    with pytest.raises(UnknownNameError) as caught:
        ability_of("rover.ldr:fly")
    assert str(caught.value) == f"nothing that a robot learns is called 'fly'; choose {names}"
