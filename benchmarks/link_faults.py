"""Seeded faults on the link while a robot is trained over a simulated radio; fails at the first
harmful one.

    python -m benchmarks link_faults --faults 1000
    # with the second stage of a real hub:
    python -m benchmarks link_faults --faults 3 --end-ms 10000 --jobs 1

Everything runs in real time: some seconds per fault, and several hubs in parallel. The hub ends its
program half a second after it has stopped its motors, not after ten as a real one, so that a
thousand take minutes.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.session import Session

TESTS = [
    str(Path(__file__).parents[1] / "packages" / tests)
    for tests in ("brickhub/tests", "brickhub/tests/hub", "bricksrl/tests/envs")
]
WORKERS = 4
"""Concurrent hubs, which mostly wait."""
_COUNTED = ("faults", "phases", "errors")
_SUMMED = ("transitions", "grown")
_LONGEST = (
    "longest_call_s",
    "longest_recovery_s",
    "longest_until_advertising_s",
    "longest_silent_drive_ms",
    "longest_grown_drive_ms",
    "watchdog_ms",
)


def course(faults: int, seed: int, end_ms: int) -> dict[str, Any]:
    """Report of the faults on one hub, run in its own process."""
    sys.path[:0] = TESTS
    program = importlib.import_module("brickhub.hub.program.generate")
    program.END_MS = end_ms  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        return dict(
            vars(importlib.import_module("fault_course").run_course(Path(folder), faults, seed))
        )


def main(session: Session) -> None:
    """Run the courses and write their summary."""
    parser = session.parser
    parser.add_argument("--course", type=int, default=25, help="consecutive faults on one hub")
    args = session.parse(faults=1000, end_ms=500, seed=0)
    sizes = [min(args.course, args.faults - start) for start in range(0, args.faults, args.course)]
    jobs = {
        f"{args.seed + number}-{size}-{args.end_ms}": (size, args.seed + number, args.end_ms)
        for number, size in enumerate(sizes)
    }
    start_s = time.monotonic()
    reports = list(session.outcomes(course, jobs, session.jobs or WORKERS))
    result = {"seed": args.seed, "second_stage_ms": args.end_ms, **summary(reports)}
    print(result)
    variant = "" if args.end_ms == 500 else "_real_second_stage"
    session.write(result | {"wall_s": round(time.monotonic() - start_s)}, variant)


def summary(reports: list[dict[str, Any]]) -> dict[str, Any]:
    """Summary of all courses so far."""
    result: dict[str, Any] = {
        "faults_in_all": sum(sum(report["faults"].values()) for report in reports)
    }
    for name in _COUNTED:
        total: Counter[str] = sum((Counter(report[name]) for report in reports), Counter())
        result[name] = dict(sorted(total.items()))
    result |= {name: sum(report[name] for report in reports) for name in _SUMMED}
    return result | {name: round(max(report[name] for report in reports), 3) for name in _LONGEST}
