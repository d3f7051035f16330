"""``Matrix``, ``vector`` and ``cross`` of ``pybricks.tools``, in 32-bit floats."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.pybricks.arguments import expect, get_array, get_exact_int, get_number


class Matrix:
    """Immutable matrix; one element is a float."""

    __slots__ = ("_rows",)
    _rows: list[list[float]]

    def __new__(cls, rows: Any) -> Any:
        if isinstance(rows, Matrix):
            return rows
        values = [[to_single(get_number(x)) for x in get_array(row)] for row in get_array(rows)]
        expect(values and values[0] and all(len(row) == len(values[0]) for row in values))
        return _from_rows(values)

    @property
    def shape(self) -> tuple[int, int]:
        return len(self._rows), len(self._rows[0])

    @property
    def T(self) -> Any:
        return _from_rows([list(column) for column in zip(*self._rows, strict=True)])

    def __iter__(self) -> Iterator[float]:
        return iter([x for row in self._rows for x in row])

    def __getitem__(self, index: Any) -> float:
        rows, columns = self.shape
        flat = list(self)
        position = -1
        if isinstance(index, int):
            position = index + len(flat) if index < 0 else index
        elif len(get_array(index)) == 2:
            row, column = (
                i + n if get_exact_int(i) < 0 else i
                for i, n in zip(index, (rows, columns), strict=True)
            )
            if 0 <= row < rows and 0 <= column < columns:
                position = row * columns + column
        if not 0 <= position < len(flat):
            raise IndexError("Matrix index out of range")
        return flat[position]

    def __repr__(self) -> str:
        lines = ("    [" + ", ".join(map(_fixed, row)) + "],\n" for row in self._rows)
        return "Matrix([\n" + "".join(lines) + "])"

    def __add__(self, other: Any) -> Any:
        return self._elementwise(other, 1)

    def __sub__(self, other: Any) -> Any:
        return self._elementwise(other, -1)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, int | float):
            return self._scaled(to_single(other))
        if not isinstance(other, Matrix):
            return NotImplemented
        expect(self.shape[1] == other.shape[0])
        columns = list(zip(*other._rows, strict=True))
        return _from_rows([[_dot(row, column) for column in columns] for row in self._rows])

    def __rmul__(self, other: Any) -> Any:
        return self._scaled(to_single(get_number(other)))

    def __truediv__(self, other: Any) -> Any:
        divisor = to_single(get_number(other))
        return self._scaled(to_single(1 / divisor) if divisor else math.inf)

    def __neg__(self) -> Any:
        return self._scaled(-1.0)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> float:
        if 1 not in self.shape:
            raise TypeError("unsupported type for __abs__: 'Matrix'")
        return to_single(math.sqrt(_dot(list(self), list(self))))

    def _scaled(self, scale: float) -> Any:
        return _from_rows([[to_single(x * scale) for x in row] for row in self._rows])

    def _elementwise(self, other: Any, sign: int) -> Any:
        if not isinstance(other, Matrix):
            return NotImplemented
        expect(self.shape == other.shape)
        pairs = zip(self._rows, other._rows, strict=True)
        return _from_rows(
            [[to_single(a + sign * b) for a, b in zip(x, y, strict=True)] for x, y in pairs]
        )


def _from_rows(rows: list[list[float]]) -> Any:
    if len(rows) == 1 and len(rows[0]) == 1:
        return rows[0][0]
    result = object.__new__(Matrix)
    result._rows = rows
    return result


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total = to_single(total + to_single(x * y))
    return total


def _fixed(x: float) -> str:
    """Three decimals, cut off, eight characters wide, at most 999.999."""
    thousandths = int(max(-1e6, min(1e6, x * 1000))) if x == x else 0
    sign = "-" if thousandths < 0 else ""
    integer, rest = divmod(min(abs(thousandths), 999_999), 1000)
    return f"{sign}{integer}".rjust(4) + f".{rest:03d}"


def vector(*values: Any) -> Matrix:
    """A column of two or three numbers."""
    if len(values) not in (2, 3):
        missing = 2 - len(values)
        too_many = f"function expected at most 3 arguments, got {len(values)}"
        raise TypeError(
            f"function missing {missing} required positional arguments" if missing > 0 else too_many
        )
    return Matrix([[x] for x in values])  # type: ignore[no-any-return]


def cross(*vectors: Any) -> Matrix:
    """Vector product of two vectors of three numbers."""
    if len(vectors) != 2:
        raise TypeError(f"function takes 2 positional arguments but {len(vectors)} were given")
    if not all(isinstance(value, Matrix) for value in vectors):
        raise TypeError("arguments must be Matrix objects")
    expect(all(sorted(value.shape) == [1, 3] for value in vectors))
    (x, y, z), (u, v, w) = vectors
    return vector(y * w - z * v, z * u - x * w, x * v - y * u)
