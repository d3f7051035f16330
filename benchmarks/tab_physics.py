"""Physics of robots in a browser tab: MuJoCo's JavaScript build against Python's, of the same
version and of ours, and what they cost.

    python -m venv /tmp/same && /tmp/same/bin/pip install mujoco==3.14.0 numpy
    python -m benchmarks tab_physics --python /tmp/same/bin/python

Five robots, in scenes with what their sensors see, are driven by swinging voltages for 10 s from 20
starts each, by the very body of a twin on three engines: JavaScript in Node.js (as in a tab's
worker: Pyodide, no NumPy), Python's MuJoCo of the same version, and ours. The noise, the starts and
the phases of the voltages, which are drawn for each start, are the same on all three.

- Against the same version: the largest difference of any position over the first second.
- Against ours, whose contacts differ: speed, turn, and the mean reading of each sensor over the
  starts. The difference of the means is within its 95 % interval (Welch), or is listed.
- CPU time of the Walker with a hub program that walks, and of a program on the bench: two motors
  and a drive base.

Takes about ten minutes. It needs Node.js and npm.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import brickhub
import bricktwin
from benchmarks import tab_motion
from benchmarks.machine import ONE_THREAD
from benchmarks.session import Session
from bricktwin.robots import ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.planned import robot_of_plan
from bricktwin.site.packages import node, unpack_packages
from bricktwin.site.robot_files import robot_file
from bricktwin.twin.objects import Field, Line, Wall, oval
from bricktwin.twin.scene import Scene

ROOT = Path(__file__).parents[1]
IN_NODE = ROOT / "packages" / "bricktwin" / "tests" / "site" / "in_node.mjs"
_HEADING_DEG = (-20.0, 20.0)
_ANYWHERE = ((-30.0, 30.0), (-30.0, 30.0))
_ROOM = (
    Line(oval(900, 500), closed=True),
    Field((60, 50), (200, 100), "black"),
    Wall((700, -500), (700, 500)),
)
ROBOTS = {
    "two-wheeler": (TWO_WHEELER, Scene(wall_distance_mm=(300.0, 500.0), heading_deg=(-20.0, 20.0))),
    "scout": (SCOUT, Scene(objects=_ROOM, heading_deg=_HEADING_DEG, start_mm=_ANYWHERE)),
    "walker": (WALKER, Scene(heading_deg=_HEADING_DEG)),
    "robo-arm": (ROBO_ARM, Scene(ball=True)),
    "six-legs": (
        robot_of_plan(str(ROOT / "examples" / "15_six_legs.ldr"), "six-legs"),
        Scene(heading_deg=_HEADING_DEG),
    ),
}
"""The robots, of which the last one is a user's, with their scenes."""
WALK = """
from pybricks.hubs import PrimeHub
from pybricks.pupdevices import Motor
from pybricks.parameters import Direction, Port
from pybricks.tools import StopWatch, wait

hub = PrimeHub()
legs = [
    Motor(Port.D, Direction.COUNTERCLOCKWISE),
    Motor(Port.C),
    Motor(Port.B, Direction.COUNTERCLOCKWISE),
    Motor(Port.A),
]
watch = StopWatch()
while True:
    goal = -watch.time() * 0.4
    for leg, phase in zip(legs, (0, 180, 180, 0)):
        leg.track_target(goal + phase)
    pitch, roll = hub.imu.tilt()
    wait(20)
"""
BENCH = """
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait

base = DriveBase(Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B), 56, 112)
while True:
    base.straight(100, wait=False)
    while not base.done():
        wait(5)
    base.turn(90)
    print(base.state())
"""
TURNS = 4
"""Runs of the hub program on each engine, of which the first warms up; medians."""
T_95 = 2.02
"""Of Student's distribution with 38 degrees of freedom."""


class Engines:
    """The engines, which run :mod:`benchmarks.tab_motion`: that of a tab, and ours.

    Args:
        folder: for the files of what is asked.
        same: Python with MuJoCo of the JavaScript build's version, for a third one.
    """

    def __init__(self, folder: Path, same: str = "") -> None:
        self._folder = folder
        self._houses = [
            str(Path(str(house.__file__)).parents[1]) for house in (brickhub, bricktwin)
        ]
        unpack_packages(folder)
        places = [str(folder / "node_modules"), *self._houses, str(folder)]
        script = [str(Path(tab_motion.__file__))]
        # Folders are mounted in their order, and the last one is that of the files.
        self._commands = {
            "tab": [node(), str(IN_NODE), *places, "--", *script, "/folder_2/asked.json"],
            "same": [same, *script, str(folder / "asked.json")],
            "ours": [sys.executable, *script, str(folder / "asked.json")],
        }

    def moved(self, name: str, **asked: Any) -> list[dict[str, Any]]:
        """What an engine answers."""
        top = "/folder_2" if name == "tab" else str(self._folder)
        files = {robot: f"{top}/{robot}.json" for robot in asked.pop("robots")}
        name_of_program = asked.pop("program", "")
        program = f"{top}/{name_of_program}" if name_of_program else ""
        whole = {"files": files, "program": program, **asked}
        (self._folder / "asked.json").write_text(json.dumps(whole), encoding="utf-8")
        paths = os.pathsep.join(self._houses)
        done = subprocess.run(  # noqa: S603  our own words, and a Python that the caller names
            self._commands[name],
            env={**os.environ, **ONE_THREAD, "PYTHONPATH": paths},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def by_robot(moved: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """What was moved, by the robot's name."""
    runs: dict[str, list[dict[str, Any]]] = {}
    for one in moved:
        runs.setdefault(one["robot"], []).append(one)
    return runs


def first_second(tab: dict[str, Any], same: dict[str, Any]) -> float:
    """Largest difference of any position."""
    largest = 0.0
    for one, other in zip(tab["positions"], same["positions"], strict=True):
        for x, y in zip(one, other, strict=True):
            largest = max(largest, abs(x - y))
    return largest


def quantities(moved: dict[str, Any]) -> dict[str, float]:
    """What is compared of one start."""
    return {
        "speed_mm_s": moved["speed_mm_s"],
        "turned_deg": moved["turned_deg"],
        **moved["means"],
    }


def compare(tab: list[dict[str, Any]], ours: list[dict[str, Any]]) -> dict[str, Any]:
    """Means over the starts, and which differences are beyond their intervals."""
    beyond = {}
    count = 0
    for name in quantities(tab[0]):
        columns = [[quantities(one)[name] for one in run] for run in (tab, ours)]
        means = [statistics.fmean(column) for column in columns]
        errors = [statistics.stdev(column) / math.sqrt(len(column)) for column in columns]
        half = T_95 * math.hypot(*errors)
        count += 1
        # What has no noise at all, such as a motor at its stop, differs in the last digit.
        if abs(means[0] - means[1]) > half + 1e-6 * max(map(abs, means)):
            beyond[name] = {"tab": means[0], "ours": means[1], "half_interval": half}
    speeds = [statistics.fmean(one["speed_mm_s"] for one in run) for run in (tab, ours)]
    return {
        "quantities": count,
        "beyond": beyond,
        "speed_tab_mm_s": round(speeds[0], 2),
        "speed_ours_mm_s": round(speeds[1], 2),
    }


def cost(
    engines: Engines,
    duration_s: float,
    **asked: Any,
) -> dict[str, Any]:
    """CPU time of a hub program in a tab and here."""
    used_s: dict[str, list[float]] = {"tab": [], "ours": []}
    texts = set()
    for engine, seconds in used_s.items():
        # The first run of a process loads what the later ones have.
        _, *moved = engines.moved(engine, duration_s=duration_s, **asked)
        seconds += [one["cpu_s"] for one in moved]
        texts |= {one["errors"] for one in moved}
    medians = {engine: statistics.median(seconds) for engine, seconds in used_s.items()}
    return {
        "simulated_s": duration_s,
        **{f"{engine}_cpu_s": round(value, 3) for engine, value in medians.items()},
        "times": round(medians["tab"] / medians["ours"], 2),
        "said": sorted(texts),
    }


def main(session: Session) -> None:
    """Measure, and write the result."""
    session.parser.add_argument("--python", required=True, metavar="PATH")
    args = session.parse(starts=20, duration=10.0)
    starts = list(range(args.starts))
    with tempfile.TemporaryDirectory(prefix="tab-physics-") as name:
        folder = Path(name)
        for robot, (description, scene) in ROBOTS.items():
            file = robot_file(description, scene)
            (folder / f"{robot}.json").write_text(json.dumps(file), encoding="utf-8")
        (folder / "walk.py").write_text(WALK, encoding="utf-8")
        (folder / "bench.py").write_text(BENCH, encoding="utf-8")
        engines = Engines(folder, args.python)
        everything = {"robots": list(ROBOTS), "starts": starts, "duration_s": args.duration}
        tab = by_robot(engines.moved("tab", **everything))
        ours = by_robot(engines.moved("ours", **everything))
        same = by_robot(
            engines.moved("same", robots=list(ROBOTS), starts=starts[:1], duration_s=1.0)
        )
        robots: dict[str, Any] = {}
        for robot in ROBOTS:
            seconds = [sum(one["cpu_s"] for one in run[robot]) for run in (tab, ours)]
            robots[robot] = {
                "first_second": first_second(tab[robot][0], same[robot][0]),
                "cpu_times": round(seconds[0] / seconds[1], 2),
                **compare(tab[robot], ours[robot]),
            }
            print(robot, robots[robot], flush=True)
        starts = [0] * TURNS
        walker = cost(engines, args.duration, program="walk.py", robots=["walker"], starts=starts)
        bench = cost(engines, args.duration, program="bench.py", robots=[], starts=[], bench=TURNS)
        programs = {"walker": walker, "bench": bench}
        print(programs, flush=True)
        session.write({"robots": robots, "programs": programs})
