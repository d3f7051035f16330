"""LEGO's kits, virtual, behind LEGO's own package: what LEGO publishes, our own programs, and drawn
faults of the link.

    git clone https://github.com/LEGO/LEGOEducation
    python -m benchmarks kit_programs --lego LEGOEducation

Each program runs in a process of its own, on a bench with a device of each kind, and its speed is
that of simulated time. Faults are drawn as in ``test_kit_link.py``: the devices are out of reach at
some time of a run, for 10 ms to 45 s. Needs the extra `legoeducation`.
"""

from __future__ import annotations

import importlib
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.session import Session

TESTS = Path(__file__).parents[1] / "packages/brickhub/tests/kits"


def program(source: str) -> dict[str, Any]:
    """Outcome of a program: exit code, its last line of errors, and seconds of wall time."""
    with tempfile.TemporaryDirectory() as folder:
        file, readings = Path(folder) / "program.py", Path(folder) / "seen.csv"
        file.write_text(source, encoding="utf-8")
        readings.write_text("0, white\n2.5, red\n", encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "brickhub",
            "run",
            str(file),
            "--reading",
            f"D=@{readings}",
            "--time-limit-s",
            "100",
        ]
        began_s = time.perf_counter()
        # - our own command
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)  # noqa: S603
        wall_s = time.perf_counter() - began_s
    return {
        "code": done.returncode,
        "error": done.stderr.strip().rpartition("\n")[2] if done.returncode else "",
        "wall_s": wall_s,
    }


def faults(count: int, seed: int) -> dict[str, Any]:
    """Draw faults in one run; it would hang or raise at a harmful one."""
    sys.path.insert(0, str(TESTS))
    began_s = time.perf_counter()
    lost = importlib.import_module("test_kit_link").course(count, seed)
    return {"faults": count, "steps_lost": lost, "wall_s": round(time.perf_counter() - began_s, 1)}


def speed() -> float:
    """Simulated seconds per second, of the cart on its course, each step of 60 ms commanded and
    read."""
    import bricksrl

    env = bricksrl.make("LineFollow-v0", seed=0, robot="cart")
    env.rollout(10)
    began_s, twin = time.perf_counter(), env.twin
    simulated_s = twin.now_s()
    env.rollout(100)
    share = (twin.now_s() - simulated_s) / (time.perf_counter() - began_s)
    env.close()
    return float(share)


def main(session: Session) -> None:
    """Run all and write the results."""
    parser = session.parser
    parser.add_argument("--lego", type=Path, metavar="DIR", help="a clone of LEGO's repository")
    args = session.parse(faults=200)
    sys.path.insert(0, str(TESTS))
    sources = importlib.import_module("lego_programs")
    programs = {f"own: {name}": sources.own(name) for name in sources.OWN}
    if args.lego is not None:
        programs |= {f"lego: {name}": source for name, source in sources.published(args.lego)}
    found = {name: program(source) for name, source in programs.items()}
    failed = {name: outcome["error"] for name, outcome in found.items() if outcome["code"]}
    sizes = [25] * (args.faults // 25) + [args.faults % 25] * bool(args.faults % 25)
    parts = {f"faults-{seed}-{size}": (size, seed) for seed, size in enumerate(sizes)}
    courses = list(session.outcomes(faults, parts))
    result = {
        "programs": {
            group: sum(name.startswith(group) for name in found) for group in ("own", "lego")
        },
        "failed": failed,
        "wall_s_median": round(
            statistics.median(outcome["wall_s"] for outcome in found.values()), 2
        ),
        "speed_of_learning": round(speed(), 1),
        "faults": sum(course["faults"] for course in courses),
        "steps_lost": sum(course["steps_lost"] for course in courses),
    }
    print(result, flush=True)
    session.write(result)
