"""Registry of the benchmarks: ``registry.csv`` and the studies."""

from __future__ import annotations

from importlib.util import find_spec

from benchmarks.session import Benchmark
from brickhub.tables import read_table

IS_WHOLE = find_spec("bricksrl") is not None
"""Whether all houses are installed; without bricksrl there are no studies and no tables."""


def _studies() -> list[Benchmark]:
    if not IS_WHOLE:
        return []
    from benchmarks.study_tables import STUDIES

    return list(STUDIES)


def _benchmark(row: dict[str, str]) -> Benchmark:
    minutes, quick_minutes = float(row["minutes"]), float(row["quick_minutes"])
    return Benchmark(
        row["name"],
        row["title"],
        minutes,
        quick_minutes,
        row["quick"],
        row["needs"],
        tuple(row["also"].split()),
    )


GROUPS: dict[str, list[Benchmark]] = {"studies of the paper's tables": _studies()}
for _row in read_table("benchmarks", "registry"):
    GROUPS.setdefault(_row["group"], []).append(_benchmark(_row))
BENCHMARKS = {benchmark.name: benchmark for group in GROUPS.values() for benchmark in group}
"""All, by name."""
