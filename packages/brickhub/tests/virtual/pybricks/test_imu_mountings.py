"""IMU in all 24 mountings of the hub, against the formulas of the firmware (``pbio/imu.c``, v4.0.1
and v4.1.0b2).

The matrix of the mounting has as columns the directions of the hub's front, left and top in the
robot. It maps vectors of the hub to the robot. The rotation of the hub maps its vectors to the
world; at the start it is the shortest one that fits gravity.
"""

from __future__ import annotations

import ast
import io
import itertools
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from brickhub.robot import HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.run import run_file

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


def scaled(vector: Vector, factor: float) -> Vector:
    x, y, z = vector
    return x * factor, y * factor, z * factor


def dot(a: Iterable[float], b: Iterable[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def apply(matrix: Matrix, vector: Vector) -> Vector:
    x, y, z = (dot(row, vector) for row in matrix)
    return x, y, z


def transposed(rows: Matrix) -> Matrix:
    x, y, z = zip(*rows, strict=True)
    return x, y, z


def product(a: Matrix, b: Matrix) -> Matrix:
    x, y, z = (apply(a, column) for column in transposed(b))
    return transposed((x, y, z))


UNIT: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
AXES = {
    f"{sign}Axis.{name}": scaled(UNIT[i], value)
    for i, name in enumerate("XYZ")
    for sign, value in (("", 1.0), ("-", -1.0))
}
MOUNTINGS = [
    (top, front) for top, front in itertools.product(AXES, AXES) if dot(AXES[top], AXES[front]) == 0
]
SIDES = (("Side.FRONT", "Side.BACK"), ("Side.LEFT", "Side.RIGHT"), ("Side.TOP", "Side.BOTTOM"))
TURN_DEG_S = (40.0, -25.0, 60.0)
HEAD = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import vector, wait
def show(imu):
    print(list(imu.tilt() + imu.tilt(calibrated=False)), list(imu.acceleration()), list(imu.angular_velocity()),
          [imu.rotation(axis) for axis in (Axis.X, Axis.Y, Axis.Z, -Axis.Y)],
          [imu.orientation()[i, j] for i in range(3) for j in range(3)], imu.heading(), imu.up(), imu.up(calibrated=False),
          [imu.acceleration(vector(1, -2, 3)), imu.angular_velocity(vector(0, 2, 1)), imu.rotation(vector(-3, 1, 1))], sep=";")
"""  # noqa: E501


def mounted(top: str, front: str) -> Matrix:
    x, z = AXES[front], AXES[top]
    return transposed((x, cross(z, x), z))


def turned(rotvec_rad: Vector) -> Matrix:
    """Rotation matrix of a rotation vector, by Rodrigues' formula."""
    angle = math.hypot(*rotvec_rad)
    axis = scaled(rotvec_rad, 1 / angle) if angle else rotvec_rad

    def image(vector: Vector) -> Vector:
        once = cross(axis, vector)
        twice = cross(axis, once)
        x, y, z = (
            v + math.sin(angle) * a + (1 - math.cos(angle)) * b
            for v, a, b in zip(vector, once, twice, strict=True)
        )
        return x, y, z

    return transposed((image(UNIT[0]), image(UNIT[1]), image(UNIT[2])))


def at_start(up: Vector) -> Matrix:
    """Rotation of the hub when it is switched on, from "up" in the hub: about a level axis, or
    about x if it is upside down."""
    level = cross(up, (0.0, 0.0, 1.0))
    if not any(level):
        level = (1.0, 0.0, 0.0)
    return turned(scaled(level, math.acos(up[2]) / math.hypot(*level)))


def tilt(up: Vector) -> list[float]:
    x, y, z = up
    return [math.degrees(math.atan2(-x, math.hypot(y, z))), math.degrees(math.atan2(y, z))]


def side(up: Vector) -> str:
    axis = max(range(3), key=lambda index: abs(up[index]))
    return SIDES[axis][int(up[axis] < 0)]


def along(vector: Vector, *axis: float) -> float:
    return dot(vector, axis) / math.hypot(*axis)


def heading(rotation: Matrix, base: Matrix) -> float:
    x, y, _ = apply(rotation, base[0])  # the robot's front, in the world
    return math.degrees(math.atan2(-y, x))


class TumblingHub(BenchBody):
    """Hub that turns for a second about an axis askew in it, and keeps the readings of that
    moment."""

    def __init__(self, turn_deg_s: Vector = TURN_DEG_S) -> None:
        super().__init__(Robot("hub", HubKind.PRIME))
        self.turn_deg_s = turn_deg_s

    @property
    def rotation(self) -> Matrix:
        return turned(scaled(self.rotation_deg(), math.radians(1)))

    def rotation_deg(self) -> Vector:
        return scaled(self.turn_deg_s, min(self._time_ms, 1000) / 1000)

    def tilt_deg(self) -> tuple[float, float]:
        pitch, roll = tilt(self.rotation[2])
        return pitch, roll

    def heading_deg(self) -> float:
        return heading(self.rotation, UNIT)

    def angular_velocity_deg_s(self) -> Vector:
        return self.turn_deg_s

    def acceleration_mm_s2(self) -> Vector:
        x, y, z = scaled(self.rotation[2], 9810.0)
        return x + 100.0, y + 200.0, z + 300.0


def shown(folder: Path, source: str, body: Body | None = None) -> list[list[Any]]:
    program, out, err = folder / "main.py", io.BytesIO(), io.StringIO()
    program.write_text(HEAD + source, encoding="utf-8")
    assert run_file(program, body, stdout=out, stderr=err) == 0, err.getvalue()
    lines = out.getvalue().decode().splitlines()
    return [
        [text if text.startswith("Side") else ast.literal_eval(text) for text in line.split(";")]
        for line in lines
    ]


def check(
    values: list[Any],
    base: Matrix,
    rotation: Matrix,
    force: Vector,
    spin: Vector,
    summed: Vector,
    within: float = 0.01,
) -> None:
    """Compare what a program sees with what the firmware computes; ``force``, ``spin`` and
    ``summed`` are vectors of the hub."""
    tilts, forces, spins, rotations, orientation, _, up, raw_up, projected = values
    assert tilts == pytest.approx(
        [*tilt(apply(base, rotation[2])), *tilt(apply(base, force))], abs=0.01
    )
    assert forces == pytest.approx(list(apply(base, force)), abs=2.4)  # a step of the accelerometer
    assert spins == pytest.approx(list(apply(base, spin)), abs=within)
    x, y, z = apply(base, summed)
    assert rotations == pytest.approx([x, y, z, -y], abs=within)
    assert orientation == pytest.approx([x for row in rotation for x in row], abs=within / 50)
    assert (up, raw_up) == (side(rotation[2]), side(force))
    askew = [
        along(apply(base, force), 1, -2, 3),
        along(apply(base, spin), 0, 2, 1),
        along(apply(base, summed), -3, 1, 1),
    ]
    assert projected[0] == pytest.approx(askew[0], abs=2.4)
    assert projected[1:] == pytest.approx(askew[1:], abs=within)


def test_there_are_24_mountings() -> None:
    assert len(MOUNTINGS) == 24
    assert all(
        dot(x, cross(y, z)) == 1 for x, y, z in (mounted(*mounting) for mounting in MOUNTINGS)
    )


def test_hub_that_has_turned_about_several_axes(tmp_path: Path) -> None:
    body = TumblingHub()
    source = "PrimeHub()\nwait(1100)\n" + "".join(
        f"show(PrimeHub({top}, {front}).imu)\n" for top, front in MOUNTINGS
    )
    for values, mounting in zip(shown(tmp_path, source, body), MOUNTINGS, strict=True):
        check(
            values,
            mounted(*mounting),
            body.rotation,
            body.acceleration_mm_s2(),
            TURN_DEG_S,
            TURN_DEG_S,
        )


@pytest.mark.parametrize(
    "mounting",
    [(top, front) for top, front in MOUNTINGS if mounted(top, front)[0][2] == 0],
    ids=str,
)
def test_heading_of_level_hub(mounting: tuple[str, str], tmp_path: Path) -> None:
    """Not if the robot's front is above or below in the hub: then the firmware has no heading, the
    stand-in that of the robot."""
    body, base = TumblingHub((0.0, 0.0, 70.0)), mounted(*mounting)
    ((*_, measured, _, _, _),) = shown(
        tmp_path, f"imu = PrimeHub({', '.join(mounting)}).imu\nwait(1100)\nshow(imu)", body
    )
    way = heading(body.rotation, base) - heading(UNIT, base)
    assert measured == pytest.approx((way + 180) % 360 - 180, abs=0.1)


@pytest.mark.parametrize("drives", ["DriveBase(left, right, 56, 112)", ""])
@pytest.mark.parametrize("mounting", MOUNTINGS, ids=str)
def test_hub_on_wheels(mounting: tuple[str, str], drives: str, tmp_path: Path) -> None:
    source = f"""
hub = PrimeHub({", ".join(mounting)})
left, right = Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B)
{drives}
left.run(200)
right.run(-200)
wait(1500)
show(hub.imu)
print(left.angle() - right.angle())
"""
    values, (degrees,) = shown(tmp_path, source)
    base, turned_deg = mounted(*mounting), degrees / 4
    up = base[2]  # the robot's vertical, in the hub
    start = at_start(up)
    rotation = product(turned((0.0, 0.0, -math.radians(turned_deg))), start)
    check(
        values,
        base,
        rotation,
        scaled(up, 9810.0),
        scaled(up, -100.0),
        scaled(up, -turned_deg),
        within=0.5,
    )
    assert values[5] == pytest.approx(turned_deg, abs=0.5)
    way = heading(rotation, base) - heading(start, base)
    assert values[5] == pytest.approx((way + 180) % 360 - 180, abs=0.5)


@pytest.mark.parametrize(
    ("top", "front"),
    [pair for pair in itertools.product(AXES, AXES) if pair not in MOUNTINGS],
    ids=str,
)
def test_sides_that_are_not_at_right_angles_are_refused(
    top: str, front: str, tmp_path: Path
) -> None:
    source = f"""
hub = PrimeHub(Axis.Y, Axis.Z)
try:
    PrimeHub({top}, {front})
except ValueError as error:
    print([str(error)])
show(hub.imu)
"""
    (refused,), values = shown(tmp_path, source)
    assert refused == ["Invalid argument"]
    assert values[2] == [0.0] * 3
    assert values[1] == pytest.approx(
        list(scaled(transposed(mounted("Axis.Y", "Axis.Z"))[2], 9809.137))
    )
