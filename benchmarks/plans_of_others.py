"""Plans that others have drawn: how many are read, how many of their parts are known, how many joints move.

    python benchmarks/plans_of_others.py FOLDER

Looks at every .ldr, .mpd and .io file below the folder. The result has counts only: no file, name or part of anybody's.
"""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import Any

from machine import command, write

from bricksrl.errors import PlanError
from bricksrl.plans.bodies import MAX_BODIES
from bricksrl.plans.check import structure_of
from bricksrl.plans.kinematics import mechanism
from bricksrl.plans.plan import Plan, read_plan

ENDINGS = (".ldr", ".mpd", ".io")


def joints(plan: Plan) -> tuple[int, int]:
    """Joints between bodies, and motors that can turn."""
    bodies = structure_of(plan).bodies
    if len(bodies.members) > MAX_BODIES:
        return 0, 0
    made = mechanism(plan, bodies)
    turning = sum(bool(abs(made.ratios[:, motor]).max(initial=0.0) > 0.01) for motor in range(len(made.ports)))
    return len(made.hinges), turning


def look(path: Path) -> dict[str, Any]:
    """Counts of one file."""
    started_s = time.process_time()
    try:
        plan = read_plan(path)
    except PlanError as error:
        return {"read": False, "reason": str(error).rpartition("; ")[0].rpartition(": ")[2].rpartition(" is ")[2][:60]}
    unknown = sum(len(one.lines) for one in plan.unknown)
    found: dict[str, Any] = {"read": True, "parts": len(plan.parts) + unknown, "known": len(plan.parts), "hinges": 0, "motors": 0}
    if plan.parts:
        found["hinges"], found["motors"] = joints(plan)
    return {**found, "cpu_s": round(time.process_time() - started_s, 2)}


def main() -> None:
    """Look at all and write the counts."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path)
    folder: Path = parser.parse_args().folder
    files = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in ENDINGS]
    found = []
    for number, path in enumerate(files, 1):
        found.append(look(path))
        print(number, found[-1], flush=True)
    read = [one for one in found if one["read"]]
    summary = {
        "files": len(found),
        "read": len(read),
        "refused": dict(Counter(one["reason"] for one in found if not one["read"])),
        "parts": sum(one["parts"] for one in read),
        "parts_known": sum(one["known"] for one in read),
        "files_all_parts_known": sum(one["parts"] == one["known"] for one in read),
        "files_with_moving_joints": sum(one["hinges"] > 0 for one in read),
        "hinges": sum(one["hinges"] for one in read),
        "each": [{name: one[name] for name in ("parts", "known", "hinges", "motors", "cpu_s") if name in one} for one in read],
    }
    print(write("plans_of_others", summary))


if __name__ == "__main__":
    main()
