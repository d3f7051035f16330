"""Seeded faults on the link while a robot is trained over a simulated radio; fails at the first harmful one.

    python benchmarks/link_faults.py --faults 1000
    python benchmarks/link_faults.py --faults 3 --end-ms 10000 --workers 1      # with the second stage of a real hub

Everything runs in real time: some seconds per fault, and several hubs in parallel; the result is written after each hub. The hub
ends its program half a second after it has stopped its motors, not after ten as a real one, so that a thousand take minutes.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from machine import command, write

PACKAGES = Path(__file__).parents[1] / "packages"
TESTS = [str(PACKAGES / folder) for folder in ("brickhub/tests", "brickhub/tests/hub", "bricksrl/tests/envs")]
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


def course(job: tuple[int, int, int]) -> dict[str, Any]:
    """Report of the faults on one hub, run in its own process."""
    faults, seed, end_ms = job
    sys.path[:0] = TESTS
    program = importlib.import_module("brickhub.hub.program.generate")
    program.END_MS = end_ms  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        return dict(vars(importlib.import_module("fault_course").run_course(Path(folder), faults, seed)))


def main() -> None:
    """Run the courses and write their summary."""
    parser = command(__doc__)
    parser.add_argument("--faults", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--course", type=int, default=25, help="consecutive faults on one hub")
    parser.add_argument("--end-ms", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    sizes = [min(args.course, args.faults - start) for start in range(0, args.faults, args.course)]
    jobs = [(size, args.seed + number, args.end_ms) for number, size in enumerate(sizes)]
    start_s = time.monotonic()
    reports: list[dict[str, Any]] = []
    name = "link_faults" if args.end_ms == 500 else "link_faults_real_second_stage"
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(course, job) for job in jobs]):
            reports.append(future.result())
            result = {"seed": args.seed, "second_stage_ms": args.end_ms, **summary(reports)}
            path = write(name, result | {"wall_s": round(time.monotonic() - start_s)})
            print(f"{len(reports)}/{len(jobs)} courses, {time.monotonic() - start_s:.0f} s", flush=True)
    print(result)
    print(path)


def summary(reports: list[dict[str, Any]]) -> dict[str, Any]:
    """Summary of all courses so far."""
    result: dict[str, Any] = {"faults_in_all": sum(report["faults"].total() for report in reports)}
    for name in _COUNTED:
        total: Counter[str] = sum((report[name] for report in reports), Counter())
        result[name] = dict(sorted(total.items()))
    result |= {name: sum(report[name] for report in reports) for name in _SUMMED}
    return result | {name: round(max(report[name] for report in reports), 3) for name in _LONGEST}


if __name__ == "__main__":
    main()
