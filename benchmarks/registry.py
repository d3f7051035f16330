"""Registry of the benchmarks: ``registry.csv`` and the studies."""

from __future__ import annotations

from importlib.util import find_spec

from benchmarks.session import Benchmark
from brickhub.tables import read_table


def _studies() -> list[Benchmark]:
    """Those of the paper's tables; none where bricksrl, with which they train, is not installed."""
    if find_spec("bricksrl") is None:
        return []
    from benchmarks.study_tables import STUDIES

    return list(STUDIES)


def _benchmark(row: dict[str, str]) -> Benchmark:
    minutes, quick_minutes = float(row["minutes"]), float(row["quick_minutes"])
    return Benchmark(row["name"], row["title"], minutes, quick_minutes, row["quick"], row["needs"], tuple(row["also"].split()))


GROUPS: dict[str, list[Benchmark]] = {"studies of the paper's tables": _studies()}
for _row in read_table("benchmarks", "registry"):
    GROUPS.setdefault(_row["group"], []).append(_benchmark(_row))
BENCHMARKS = {benchmark.name: benchmark for group in GROUPS.values() for benchmark in group}
"""All, by name."""
