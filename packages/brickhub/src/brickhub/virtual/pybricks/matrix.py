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
        # A matrix cannot be changed, so its rows can be shared.
        if isinstance(rows, Matrix):
            return rows
        values = []
        for row in get_array(rows):
            values.append([to_single(get_number(number)) for number in get_array(row)])
        expect(values and values[0])
        columns = len(values[0])
        expect(all(len(row) == columns for row in values))
        return _from_rows(values)

    @property
    def shape(self) -> tuple[int, int]:
        return len(self._rows), len(self._rows[0])

    @property
    def T(self) -> Any:
        columns = zip(*self._rows, strict=True)
        return _from_rows([list(column) for column in columns])

    def __iter__(self) -> Iterator[float]:
        # MicroPython's own iterator of the class goes row by row.
        return iter([number for row in self._rows for number in row])

    def __getitem__(self, index: Any) -> float:
        rows, columns = self.shape
        flat = list(self)
        # For an index that the matrix does not have, this stays out of range.
        position = -1
        if isinstance(index, int):
            position = index + len(flat) if index < 0 else index
        elif len(get_array(index)) == 2:
            row = _from_end(index[0], rows)
            column = _from_end(index[1], columns)
            if 0 <= row < rows and 0 <= column < columns:
                position = row * columns + column
        if not 0 <= position < len(flat):
            raise IndexError("Matrix index out of range")
        return flat[position]

    def __repr__(self) -> str:
        lines = []
        for row in self._rows:
            numbers = ", ".join(map(_fixed, row))
            lines.append(f"    [{numbers}],\n")
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
        products = []
        for row in self._rows:
            products.append([_dot(row, column) for column in columns])
        return _from_rows(products)

    def __rmul__(self, other: Any) -> Any:
        return self._scaled(to_single(get_number(other)))

    def __truediv__(self, other: Any) -> Any:
        # The firmware multiplies by the reciprocal. That rounds once more than a division, and
        # dividing by 0 gives infinity.
        divisor = to_single(get_number(other))
        reciprocal = to_single(1 / divisor) if divisor else math.inf
        return self._scaled(reciprocal)

    def __neg__(self) -> Any:
        return self._scaled(-1.0)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> float:
        if 1 not in self.shape:
            raise TypeError("unsupported type for __abs__: 'Matrix'")
        numbers = list(self)
        return to_single(math.sqrt(_dot(numbers, numbers)))

    def _scaled(self, scale: float) -> Any:
        scaled = []
        for row in self._rows:
            scaled.append([to_single(number * scale) for number in row])
        return _from_rows(scaled)

    def _elementwise(
        self,
        other: Any,
        sign: int,
    ) -> Any:
        if not isinstance(other, Matrix):
            return NotImplemented
        expect(self.shape == other.shape)
        sums = []
        for row, other_row in zip(self._rows, other._rows, strict=True):
            pairs = zip(row, other_row, strict=True)
            sums.append([to_single(a + sign * b) for a, b in pairs])
        return _from_rows(sums)


def _from_end(index: Any, size: int) -> int:
    """An index as counted from the start; negative ones count from the end."""
    number: int = get_exact_int(index)
    return number + size if number < 0 else number


def _from_rows(rows: list[list[float]]) -> Any:
    # On a hub, the product of a row and a column is a number and not a matrix.
    if len(rows) == 1 and len(rows[0]) == 1:
        return rows[0][0]
    result = object.__new__(Matrix)
    result._rows = rows
    return result


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    # Each operation is rounded to 32 bits, as by the hub's processor.
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total = to_single(total + to_single(x * y))
    return total


def _fixed(x: float) -> str:
    """Three decimals, cut off, eight characters wide, at most 999.999."""
    # The value is limited before it becomes an integer, which infinity cannot. A NaN, which differs
    # from itself, is shown as 0.
    thousandths = 0
    if x == x:
        thousandths = int(max(-1e6, min(1e6, x * 1000)))
    sign = "-" if thousandths < 0 else ""
    magnitude = min(abs(thousandths), 999_999)
    integer, rest = divmod(magnitude, 1000)
    return f"{sign}{integer}".rjust(4) + f".{rest:03d}"


def vector(*values: Any) -> Matrix:
    """A column of two or three numbers."""
    if len(values) not in (2, 3):
        missing = 2 - len(values)
        if missing > 0:
            raise TypeError(f"function missing {missing} required positional arguments")
        raise TypeError(f"function expected at most 3 arguments, got {len(values)}")
    return Matrix([[number] for number in values])  # type: ignore[no-any-return]


def cross(*vectors: Any) -> Matrix:
    """Vector product of two vectors of three numbers."""
    if len(vectors) != 2:
        raise TypeError(f"function takes 2 positional arguments but {len(vectors)} were given")
    if not all(isinstance(value, Matrix) for value in vectors):
        raise TypeError("arguments must be Matrix objects")
    expect(all(sorted(value.shape) == [1, 3] for value in vectors))
    (x, y, z), (u, v, w) = vectors
    return vector(
        y * w - z * v,
        z * u - x * w,
        x * v - y * u,
    )
