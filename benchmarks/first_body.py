"""First body of a process: CPU time with its robot's model kept in the cache, and without.

    python -m benchmarks first_body

Each measurement is a process of its own, which imports MuJoCo, imports and makes the robot and its
first body, and then a later body. The result is the time of the first body with its imports, less
that of the later one. Processes with the model kept and without a cache take turns, after one that
warms up; medians. Takes about a minute.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from typing import Any

from benchmarks.machine import ONE_THREAD
from benchmarks.session import Session

ROBOTS = {
    "walker": "robots.WALKER",
    "robo-arm": "robots.ROBO_ARM",
    "two-wheeler": "robots.TWO_WHEELER",
    "plan=walker.ldr": "robot_of_plan('bricktwin.robots.plans:walker.ldr', 'mine')",
}
"""Expressions of the robots."""
_PROCESS = """
import json, time
started_s = time.process_time()
import mujoco
imported_s = time.process_time()
from bricktwin import robots
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.make_body import make_body
robot = {robot}
make_body(robot)
first_s = time.process_time()
make_body(robot)
later_s = time.process_time()
print(json.dumps([imported_s - started_s, first_s - imported_s, later_s - first_s]))
"""


def measure(robot: str, cache: str) -> tuple[float, float, float]:
    """CPU seconds of a process: import of MuJoCo, first and later body."""
    environment = {**os.environ, **ONE_THREAD, "XDG_CACHE_HOME": cache}
    code = _PROCESS.format(robot=ROBOTS[robot])
    # - our own code
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", code], env=environment, capture_output=True, check=True
    )
    mujoco_s, first_s, later_s = json.loads(done.stdout)
    return mujoco_s, first_s, later_s


def main(session: Session) -> None:
    """Measure all robots and write the medians."""
    args = session.parse(runs=15)
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for robot in ROBOTS:
            caches = {"kept": folder, "built": os.devnull}
            times: dict[str, list[tuple[float, float, float]]] = {name: [] for name in caches}
            for _ in range(args.runs + 1):
                for name, cache in caches.items():
                    times[name].append(measure(robot, cache))
            above = {
                name: [first_s - later_s for _, first_s, later_s in times[name][1:]]
                for name in caches
            }
            results[robot] = {
                f"{name}_cpu_s": round(statistics.median(values), 3)
                for name, values in above.items()
            }
            results[robot]["kept_max_cpu_s"] = round(max(above["kept"]), 3)
            results[robot]["import_mujoco_cpu_s"] = round(
                statistics.median(row[0] for row in times["kept"][1:]), 3
            )
            print(robot, results[robot])
    session.write({"runs": args.runs, "robots": results})
