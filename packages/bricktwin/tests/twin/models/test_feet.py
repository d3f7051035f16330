"""Feet of robots from plans: what touches the floor, at every angle of the motors."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bricktwin.plans.geometry import Floats, Form, rotation
from bricktwin.plans.mechanism.roles import moved_by
from bricktwin.plans.planned_robot import PlannedRobot, planned_robot
from bricktwin.robots import plans
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.models.balance import standing_shapes
from bricktwin.twin.models.feet import (
    Shape,
    _fewest,
    _if_level,
    _joined,
    _without_gap,
    downwards,
    feet_of,
    shapes_of,
    turns_of,
)
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

EXAMPLES = Path(__file__).parents[5] / "examples"
WALKERS = sorted((EXAMPLES / "walkers").glob("*.ldr"))
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)


def walker(name: str) -> PlannedRobot:
    return planned_robot(EXAMPLES / "walkers" / f"{name}.ldr")


def by_body(feet: tuple[Shape, ...]) -> dict[int, list[Shape]]:
    found: dict[int, list[Shape]] = {}
    for foot in feet:
        found.setdefault(foot.body, []).append(foot)
    return found


def test_each_arm_of_a_star_is_a_foot() -> None:
    assert [len(feet) for feet in by_body(feet_of(walker("star_wheels"))).values()] == [4] * 4


def test_both_ends_of_a_beam_that_turns_about_its_middle_are_feet() -> None:
    made = walker("two_legs")
    legs = by_body(feet_of(made))
    assert len(legs) == 2
    for drive in made.articulation.drives:
        heights_m = [foot.centre_m[2] - drive.joint.point_m[2] for foot in legs[drive.joint.child]]
        assert sorted(heights_m) == pytest.approx([-0.032, 0.032], abs=1e-6)


def test_a_plate_touches_as_the_box_that_it_is() -> None:
    made = walker("plate_feet")
    for feet in by_body(feet_of(made)).values():
        lowest = feet[0] if len(feet) == 1 else min(feet, key=lambda foot: foot.lowest_m)
        assert lowest.form is Form.BOX
        assert made.plan.parts[lowest.part].part.family == "plates"


def test_heel_and_toe_of_a_bent_leg_touch() -> None:
    made = planned_robot(EXAMPLES / "15_six_legs.ldr")
    assert [len(feet) for feet in by_body(feet_of(made)).values()] == [2] * 6


def test_walker_stands_on_the_ends_of_its_legs_alone() -> None:
    made = planned_robot(Path(plans.__path__[0]) / "walker.ldr")
    feet = standing_shapes(made)
    assert [made.plan.parts[foot.part].part.number for foot in feet] == ["41239"] * 4
    assert all(foot.is_level for foot in feet)
    # Its foot is three beams thick.
    assert [foot.half_m[2] for foot in feet] == pytest.approx([0.012] * 4)


def test_what_drags_is_a_foot_where_legs_alone_do_not_carry_the_robot() -> None:
    made = walker("two_legs")
    dragged = [foot for foot in standing_shapes(made) if foot.body == 0]
    assert min(foot.centre_m[0] for foot in dragged) < -0.1
    assert not [foot for foot in standing_shapes(walker("star_wheels")) if foot.body == 0]


@pytest.mark.parametrize("path", WALKERS, ids=lambda path: path.stem)
def test_nothing_but_feet_and_chassis_is_lowest_in_a_turn(path: Path) -> None:
    made = planned_robot(path)
    turns = turns_of(made)
    downwards = np.array([[0.0, 0.0, -1.0]])

    def reach_m(shape: Shape, pose: int) -> float:
        rotations, shifts_m = turns[shape.body]
        turned = downwards @ rotations[pose]
        return float(shape.reach_m(turned)[0] + downwards[0] @ shifts_m[pose])

    bodies = range(len(made.articulation.bodies))
    everything = [shape for body in bodies if body in turns for shape in shapes_of(made, body)]
    touching = [*feet_of(made), *shapes_of(made, 0)]
    for pose in range(0, len(turns[0][0]), 3):
        lowest_m = max(reach_m(shape, pose) for shape in everything)
        assert max(reach_m(shape, pose) for shape in touching) == pytest.approx(lowest_m, abs=1e-3)


@pytest.mark.parametrize("path", WALKERS, ids=lambda path: path.stem)
def test_robot_is_put_down_on_its_feet(path: Path) -> None:
    one = MujocoBody(robot_of_plan(path), OPEN_FLOOR, QUIET, 0)
    start_m = np.array(one.data.qpos[:3])
    one.advance_to(500)
    assert np.abs(one.data.qpos[:3] - start_m).max() < 0.002
    touching = {one.model.geom(geom).name for contact in one.data.contact for geom in contact.geom}
    assert len([name for name in touching if name.startswith("foot_")]) >= 3


def with_long_rockers(folder: Path) -> Path:
    """Four legs whose rockers go on beyond their pins, so that they are no rods."""
    text = (EXAMPLES / "walkers" / "four_legs_two_motors.ldr").read_text()
    path = folder / "long_rockers.ldr"
    path.write_text(text.replace("32523.dat", "32316.dat"))
    return path


@pytest.mark.parametrize(
    ("name", "rods", "loops"),
    [
        ("four_legs_two_motors", 4, 0),
        ("klann_legs", 8, 0),
        ("six_legs_two_motors", 0, 0),
        ("long_rockers", 0, 4),
    ],
)
def test_linkages_neither_open_nor_flip_in_full_turns(
    name: str,
    rods: int,
    loops: int,
    tmp_path: Path,
) -> None:
    made = walker(name) if rods or not loops else planned_robot(with_long_rockers(tmp_path))
    assert (len(made.articulation.rods), len(made.articulation.loops)) == (rods, loops)
    one = MujocoBody(robot_of_plan(made.plan.path), OPEN_FLOOR, QUIET, 0)
    for drive in made.articulation.drives:
        # One side is faster, so that the legs meet in all phases.
        share = 1.0 if drive.joint.point_m[1] > 0 else 0.9
        sign = 1 if drive.joint.axis[1] > 0 else -1
        one.set_voltage(drive.port, round(8000 * sign * share))
    is_tie = one.model.eq_type != mujoco.mjtEq.mjEQ_JOINT
    widest_m = 0.0
    for time_ms in range(50, 2500, 50):
        one.advance_to(time_ms)
        rows = one.data.efc_id[: one.data.ne]
        gaps_m = np.abs(one.data.efc_pos[: one.data.ne])[is_tie[rows]]
        widest_m = max(widest_m, float(gaps_m.max(initial=0.0)))
    # At full speed, rods and pins separate by less than a millimetre.
    assert widest_m < 0.001

    chassis = one.data.body("chassis").xmat.reshape(3, 3)
    turns = turns_of(made)
    poses = len(turns[0][0])
    for drive in made.articulation.drives:
        angle_deg = one.angle_mdeg(drive.port) / 1000
        assert abs(angle_deg) > 720
        pose = round(angle_deg / abs(drive.gear) / 360 * poses) % poses
        for number in moved_by(made.articulation, drive):
            own = "driven_" + drive.port if number == drive.joint.child else f"part_{number}"
            turned = chassis.T @ one.data.body(own).xmat.reshape(3, 3)
            expected = turns[number][0][pose]
            cosine = (np.trace(expected.T @ turned) - 1) / 2
            # Half of the way between two poses is 4 degrees, and gears give way by as many. A leg
            # that has flipped is off by tens of degrees.
            assert math.degrees(math.acos(min(1.0, cosine))) < 15


def test_what_is_in_line_with_a_wheel_belongs_to_it_up_to_a_gap() -> None:
    def disc(from_mm: float, to_mm: float) -> Shape:
        axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        middle_m = np.array([(from_mm + to_mm) / 2000, 0.2, 0.1])
        half_m = np.array([0.02, 0.02, (to_mm - from_mm) / 2000])
        return Shape(0, 0, Form.CYLINDER, middle_m, axes, half_m)

    wheel, tyre, bush = disc(-10, 10), disc(13, 20), disc(-18, -12)
    far = [disc(-60, -40), disc(30, 50)]
    ends_m = _without_gap(wheel, [far[0], tyre, wheel, bush, far[1]])
    assert ends_m == pytest.approx((-0.018, 0.020))


TURNED = rotation((0.6, 0.0, 0.8), 0.7)
CENTRE_M = np.array([0.1, -0.2, 0.3])


def surface_points(form: Form) -> Floats:
    """Points [n, 3] all over a solid of half sizes 3, 2 and 1 cm, or of radius 3 cm."""
    angles = np.linspace(0.0, 2 * math.pi, 181)
    circle = 0.03 * np.column_stack([np.cos(angles), np.sin(angles)])
    if form is Form.BOX:
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        return signs * [0.03, 0.02, 0.01]
    if form is Form.CYLINDER:
        return np.concatenate([np.column_stack([circle, np.full(181, z)]) for z in (-0.01, 0.01)])
    heights = np.linspace(-1.0, 1.0, 181)[:, None, None]
    rings = np.sqrt(1.0 - heights**2) * circle[None]
    return np.concatenate([rings, np.broadcast_to(0.03 * heights, (181, 181, 1))], 2).reshape(-1, 3)


@pytest.mark.parametrize("form", [Form.BOX, Form.CYLINDER, Form.BALL])
def test_a_shape_reaches_as_far_as_its_farthest_point(form: Form) -> None:
    axes = TURNED.T
    shape = Shape(1, 2, form, CENTRE_M, axes, np.array([0.03, 0.03, 0.01]))
    if form is Form.BOX:
        shape = shape._replace(half_m=np.array([0.03, 0.02, 0.01]))
    points = surface_points(form) @ axes + CENTRE_M
    directions = np.random.default_rng(0).standard_normal((40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    farthest = (points @ directions.T).max(axis=0)
    assert shape.reach_m(directions) == pytest.approx(farthest, abs=2e-5)
    assert shape.lowest_m == pytest.approx(points[:, 2].min(), abs=2e-5)
    # The axis of a cylinder ends at its ends.
    start, end = shape.ends_m
    assert np.linalg.norm(end - start) == pytest.approx(0.02)
    assert (start + end) / 2 == pytest.approx(CENTRE_M) and shape.axis is not None
    assert np.cross(end - start, TURNED[:, 2]) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_a_chassis_is_tilted_to_each_side_and_each_corner() -> None:
    straight, *aslant = downwards(15.0)
    assert straight.tolist() == [0.0, 0.0, -1.0] and len(aslant) == 8
    for direction in aslant:
        assert direction @ straight == pytest.approx(math.cos(math.radians(15.0)))
        assert np.linalg.norm(direction) == pytest.approx(1.0)
    azimuths = sorted(round(math.degrees(math.atan2(y, x))) % 360 for x, y, _ in aslant)
    assert azimuths == [0, 45, 90, 135, 180, 225, 270, 315]


def test_as_few_shapes_are_kept_as_reach_all() -> None:
    def chosen(*rows: str) -> list[int]:
        return _fewest(np.array([[mark == "x" for mark in row] for row in rows]))

    assert chosen("xx....", ".xxxx.", "....xx") == [1, 0, 2]
    assert chosen("x..", "xxx", "..x") == [1]
    # What nobody reaches takes nobody; of equal ones the first is taken.
    assert chosen("x.", "x.") == [0]
    assert chosen("..", "..") == []


def rod(along_m: float, half_m: float, **changes: object) -> Shape:
    """A level cylinder of 3 mm along y, this far from the origin."""
    centre_m = np.array([0.0, along_m, 0.0])
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    half = np.array([0.003, 0.003, half_m])
    shape = Shape(1, 0, Form.CYLINDER, centre_m, axes, half, is_level=True)
    return shape._replace(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("other", "spans_mm"),
    [
        # Side by side, or less than 4 mm apart, they are one; from -10 mm to ...
        (rod(0.020, 0.010), [(-10, 30)]),
        (rod(0.023, 0.010), [(-10, 33)]),
        (rod(-0.023, 0.010), [(-33, 10)]),
        (rod(0.025, 0.010), [(-10, 10), (15, 35)]),
        # Within the other one, or overlapping it.
        (rod(0.002, 0.004), [(-10, 10)]),
        (rod(0.015, 0.010), [(-10, 25)]),
        # Beside its axis.
        (rod(0.020, 0.010, centre_m=np.array([0.001, 0.020, 0.0])), [(-10, 30)]),
        (rod(0.020, 0.010, centre_m=np.array([0.002, 0.020, 0.0])), [(-10, 10), (10, 30)]),
        # What stands upright is not joined.
        (rod(0.020, 0.010, is_level=False), [(10, 30), (-10, 10)]),
    ],
)
def test_level_cylinders_in_one_line_are_one(other: Shape, spans_mm: list[tuple[int, int]]) -> None:
    joined = _joined([rod(0.0, 0.010), other])
    found = [tuple(round(1000 * end[1]) for end in shape.ends_m) for shape in joined]
    assert found == spans_mm
    assert all(shape.half_m[0] == 0.003 for shape in joined)


def test_the_lowest_of_joined_cylinders_gives_their_radius() -> None:
    thick = rod(0.020, 0.010)._replace(half_m=np.array([0.005, 0.005, 0.010]))
    for shapes in ([rod(0.0, 0.010), thick], [thick, rod(0.0, 0.010)]):
        (joined,) = _joined(shapes)
        assert joined.half_m.tolist() == pytest.approx([0.005, 0.005, 0.020])
        assert joined.centre_m == pytest.approx([0.0, 0.010, 0.0])


@pytest.mark.parametrize(
    ("axis", "turn_deg", "is_level"),
    [
        # About its own axis or the vertical it stays on its side; about another it stands up.
        ((0.0, 1.0, 0.0), 90.0, True),
        ((0.0, 0.0, 1.0), 90.0, True),
        ((1.0, 0.0, 0.0), 5.0, True),
        ((1.0, 0.0, 0.0), 7.0, False),
        ((1.0, 0.0, 0.0), -30.0, False),
    ],
)
def test_a_cylinder_is_level_if_it_lies_on_its_side_in_all_poses(
    axis: tuple[float, float, float], turn_deg: float, is_level: bool
) -> None:
    poses = np.array([np.eye(3), rotation(axis, math.radians(turn_deg)), np.eye(3)])
    turns = (poses, np.zeros((3, 3)))
    assert _if_level(rod(0.0, 0.01, is_level=False), turns).is_level is is_level
    assert not _if_level(rod(0.0, 0.01, form=Form.BOX, is_level=False), turns).is_level
