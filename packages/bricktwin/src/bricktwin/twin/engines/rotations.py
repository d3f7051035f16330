"""Rotations of single vectors of three by unit quaternions ``(w, x, y, z)``, in plain Python, which
is faster than NumPy for so few values.

A body computes with these in each reading. Terms are summed in MuJoCo's order, so that the results
are equal to those of its own functions, bit for bit.
"""

import math
from collections.abc import Iterable, Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]
"""Rows of a matrix [3, 3]."""

_LEAST = 1e-15
"""Length below which a vector has no direction, as in MuJoCo."""


def vector(values: Iterable[float]) -> Vector:
    """The three numbers of a vector."""
    x, y, z = values
    return x, y, z


def plus(first: Vector, second: Vector) -> Vector:
    """Sum of two vectors."""
    return first[0] + second[0], first[1] + second[1], first[2] + second[2]


def minus(first: Vector, second: Vector) -> Vector:
    """Difference of two vectors."""
    return first[0] - second[0], first[1] - second[1], first[2] - second[2]


def times(factor: float, of: Vector) -> Vector:
    """A vector times a number."""
    return factor * of[0], factor * of[1], factor * of[2]


def dot(first: Vector, second: Vector) -> float:
    """Scalar product."""
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def cross(first: Vector, second: Vector) -> Vector:
    """Vector product."""
    a, b, c = first
    x, y, z = second
    return b * z - c * y, c * x - a * z, a * y - b * x


def rotated(of: Sequence[float], by: Sequence[float]) -> Vector:
    """A vector, rotated by a quaternion."""
    x, y, z = of
    w, i, j, k = by
    # v + 2 u x (w v + u x v), with the imaginary part u.
    a = w * x + j * z - k * y
    b = w * y + k * x - i * z
    c = w * z + i * y - j * x
    return (
        x + 2.0 * (j * c - k * b),
        y + 2.0 * (k * a - i * c),
        z + 2.0 * (i * b - j * a),
    )


def rotated_back(of: Sequence[float], by: Sequence[float]) -> Vector:
    """A vector, rotated by the inverse of a quaternion."""
    w, i, j, k = by
    return rotated(of, (w, -i, -j, -k))


def inverse(of: Sequence[float]) -> Quaternion:
    """The opposite rotation."""
    w, i, j, k = of
    return w, -i, -j, -k


def product(first: Sequence[float], second: Sequence[float]) -> Quaternion:
    """The second rotation, followed by the first."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def turn_between(now: Sequence[float], before: Sequence[float]) -> Vector:
    """Rotation vector (rad), in the turned axes, of the shorter way from one orientation to
    another."""
    w, x, y, z = product(inverse(before), now)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < _LEAST:
        # No turn, or a whole one.
        return 0.0, 0.0, 0.0
    angle = 2.0 * math.atan2(sine, w)
    if angle > math.pi:
        angle -= 2.0 * math.pi
    scale = 1.0 / sine
    return x * scale * angle, y * scale * angle, z * scale * angle


def about(axis: Vector, angle: float) -> Quaternion:
    """Quaternion of a turn about a unit axis, in radians."""
    sine = math.sin(angle / 2)
    x, y, z = axis
    return math.cos(angle / 2), x * sine, y * sine, z * sine


def yaw_quaternion(angle: float) -> Quaternion:
    """Quaternion of a rotation about the vertical, counter-clockwise seen from above, in
    radians."""
    return math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)


def from_vertical(to: Vector) -> Quaternion:
    """Quaternion of the shortest turn of the z axis to a direction of any length."""
    x, y, z = to
    length = math.sqrt(x * x + y * y + z * z)
    if length < _LEAST:
        return 1.0, 0.0, 0.0, 0.0
    across = math.hypot(x, y)
    if across < _LEAST * length:
        # Along the axis: no turn, or half a turn about x.
        return (1.0, 0.0, 0.0, 0.0) if z > 0.0 else (0.0, 1.0, 0.0, 0.0)
    axis = (-y / across, x / across, 0.0)
    return about(axis, math.atan2(across, z))


def matrix_of(of: Sequence[float]) -> Matrix:
    """Rotation matrix of a quaternion, by rows; its columns are the turned axes."""
    w, x, y, z = of
    return (
        (w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )


def principal_axes(of: Matrix) -> tuple[Vector, Quaternion]:
    """Principal moments of a symmetric matrix, and the rotation to their axes (Jacobi's
    method)."""
    turn: Quaternion = (1.0, 0.0, 0.0, 0.0)
    size = sum(abs(of[axis][axis]) for axis in range(3))
    moments = vector(of[axis][axis] for axis in range(3))
    # Each turn takes a product away, and some ten do; what is no number would never end.
    for _ in range(_MOST_TURNS):
        columns = [rotated(axis, turn) for axis in _AXES]
        images = [vector(dot(row, column) for row in of) for column in columns]
        moments = vector(dot(columns[axis], images[axis]) for axis in range(3))
        # Products of inertia in the plane across each axis.
        products = [dot(columns[axis - 2], images[axis - 1]) for axis in range(3)]
        axis = max(range(3), key=lambda number: abs(products[number]))
        if abs(products[axis]) <= _NO_PRODUCT * size:
            break
        # The turn in that plane after which its product is 0.
        difference = moments[axis - 2] - moments[axis - 1]
        angle = math.atan2(2.0 * products[axis], difference) / 2.0
        turn = product(turn, about(_AXES[axis], angle))
    return moments, turn


_AXES: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MOST_TURNS = 60
_NO_PRODUCT = 1e-13
"""Product of inertia, as a share of the moments, that is rounding."""
