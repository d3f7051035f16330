"""Cholesky factor of a covariance matrix that grows by a row at a time."""

import math
from collections.abc import Iterable, Sequence
from operator import mul


def dot(first: Iterable[float], second: Iterable[float]) -> float:
    """Inner product, as long as the shorter of the two."""
    return sum(map(mul, first, second), 0.0)


class Cholesky:
    """Lower triangular root of a positive definite matrix: ``root @ root.T`` is the matrix.

    A row costs as many products as the matrix has entries; rows that are added one by one give the
    same numbers, to the last digit, as a whole matrix at once.

    Attributes:
        rows: rows ``[k]`` of the root, each up to its diagonal.
    """

    def __init__(self) -> None:
        self.rows: list[list[float]] = []

    def __len__(self) -> int:
        return len(self.rows)

    def append(self, covariances: Sequence[float], variance: float) -> None:
        """Add a row: covariances ``[k]`` with the rows so far, then the variance.

        Raises ValueError if the matrix is not positive definite any more.
        """
        row = self.half_solve(covariances)
        rest = variance - dot(row, row)
        # A NaN is refused too.
        if not rest > 0.0:
            raise ValueError("the matrix is not positive definite; add noise to its diagonal")
        row.append(math.sqrt(rest))
        self.rows.append(row)

    def half_solve(self, values: Sequence[float]) -> list[float]:
        """Solution ``x`` ``[k]`` of ``root @ x = values``."""
        solution: list[float] = []
        for row, value in zip(self.rows, values, strict=True):
            # The product ends with the solution so far.
            solution.append((value - dot(row, solution)) / row[-1])
        return solution

    def solve(self, values: Sequence[float]) -> list[float]:
        """Solution ``x`` ``[k]`` of ``matrix @ x = values``."""
        rest = self.half_solve(values)
        solution = rest[:]
        for index in range(len(rest) - 1, -1, -1):
            row = self.rows[index]
            value = rest[index] / row[-1]
            solution[index] = value
            # What this entry adds to all before it, so that rows are read and no columns.
            rest = [before - value * entry for before, entry in zip(rest, row[:-1], strict=False)]
        return solution

    def inverse_columns(self) -> list[list[float]]:
        """Columns ``[k]`` of the root's inverse, each from its diagonal down."""
        columns: list[list[float]] = []
        for start in range(len(self.rows)):
            column = [1.0 / self.rows[start][start]]
            for row in self.rows[start + 1 :]:
                column.append(-dot(row[start:], column) / row[-1])
            columns.append(column)
        return columns

    def log_determinant(self) -> float:
        """Logarithm of the matrix's determinant."""
        return 2.0 * sum(math.log(row[-1]) for row in self.rows)
