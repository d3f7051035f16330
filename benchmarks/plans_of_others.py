"""Plans by others: how many are read, how many of their parts are known, how many joints move.

    python -m benchmarks plans_of_others FOLDER

Reads every .ldr, .mpd and .io file below the folder. The result has counts only, nothing of the
files themselves; those whose digest is in ``plans_of_others.csv`` are counted under their
repository's name too.
"""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.tables import read_table
from bricksrl.errors import PlanError
from bricktwin.plans.bodies import MAX_BODIES
from bricktwin.plans.check import check, structure_of
from bricktwin.plans.mechanism.kinematics import mechanism
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Plan, read_plan

ENDINGS = (".ldr", ".mpd", ".io")
_COLUMNS = (
    "parts",
    "known",
    "hinges",
    "motors",
    "motors_turning",
    "wheels",
    "wheels_driven",
    "cpu_s",
)
_TURNS = 0.02
_LISTED = ("parts", "known", "collisions", "loose", "findings", "motors_turning", "wheels_driven")


def moving(plan: Plan) -> dict[str, int]:
    """Joints between bodies, motors that can turn, wheels, and wheels that a motor turns."""
    wheels = [placed.index for placed in plan.parts if placed.part.wheel_mm]
    counts = {"hinges": 0, "motors_turning": 0, "wheels": len(wheels), "wheels_driven": 0}
    bodies = structure_of(plan).bodies
    if len(bodies.members) > MAX_BODIES:
        return counts
    motions = bodies.motions()
    body_of = {part: number for number, parts in enumerate(bodies.members) for part in parts}
    driven = set()
    for rates in [joint.rates(motions) for joint in bodies.joints if joint.motor is not None]:
        if abs(rates).max(initial=0.0) < _TURNS:
            continue
        counts["motors_turning"] += 1
        # the least motion in which the shaft makes one turn
        least = motions @ rates / (rates @ rates)
        turning = least.reshape(-1, 6)[:, 3:]
        driven |= {
            wheel
            for wheel in wheels
            if wheel in body_of and abs(turning[body_of[wheel]] - turning[0]).max() > _TURNS
        }
    return {**counts, "hinges": len(mechanism(plan, bodies).hinges), "wheels_driven": len(driven)}


def look(path: Path) -> dict[str, Any]:
    """Counts of one file."""
    started_s = time.process_time()
    try:
        plan = read_plan(path)
    except PlanError as error:
        said = str(error).replace(f"{path} ", "").rpartition("; ")[0]
        return {"read": False, "reason": said.rpartition(": ")[2].rpartition(" is ")[2][:60]}
    unknown = sum(len(unknown_part.lines) for unknown_part in plan.unknown)
    counts: dict[str, Any] = {
        "read": True,
        "parts": len(plan.parts) + unknown,
        "known": len(plan.parts),
    }
    found = Counter(finding.name for finding in check(plan))
    counts |= {"collisions": found["collision"], "loose": found["loose"], "findings": found.total()}
    counts |= {
        "motors": len(plan.devices(DeviceKind.MOTOR)),
        "hinges": 0,
        "motors_turning": 0,
        "wheels": 0,
        "wheels_driven": 0,
    }
    if plan.parts:
        counts |= moving(plan)
    return {**counts, "cpu_s": round(time.process_time() - started_s, 2)}


def main(session: Session) -> None:
    """Read all and write the counts."""
    parser = session.parser
    parser.add_argument("folder", type=Path)
    folder: Path = session.parse().folder
    files = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in ENDINGS]
    names = {
        row["sha256"]: f"{row['repository']}: {row['path']}"
        for row in read_table("benchmarks", "plans_of_others")
    }
    counts, listed = [], {}
    for number, path in enumerate(files, 1):
        counts.append(look(path))
        print(number, counts[-1], flush=True)
        if name := names.get(hashlib.sha256(path.read_bytes()).hexdigest()):
            listed[name] = {
                key: counts[-1][key] for key in ("read", "reason", *_LISTED) if key in counts[-1]
            }
    read = [file_counts for file_counts in counts if file_counts["read"]]
    summary = {
        "files": len(counts),
        "read": len(read),
        "refused": dict(
            Counter(file_counts["reason"] for file_counts in counts if not file_counts["read"])
        ),
        "parts": sum(file_counts["parts"] for file_counts in read),
        "parts_known": sum(file_counts["known"] for file_counts in read),
        "files_all_parts_known": sum(
            file_counts["parts"] == file_counts["known"] for file_counts in read
        ),
        "files_with_moving_joints": sum(file_counts["hinges"] > 0 for file_counts in read),
        "hinges": sum(file_counts["hinges"] for file_counts in read),
        "motors": sum(file_counts["motors"] for file_counts in read),
        "motors_turning": sum(file_counts["motors_turning"] for file_counts in read),
        "files_with_motors": sum(file_counts["motors"] > 0 for file_counts in read),
        "files_whose_motors_all_turn": sum(
            0 < file_counts["motors"] == file_counts["motors_turning"] for file_counts in read
        ),
        "files_with_motors_and_wheels": sum(
            file_counts["motors"] > 0 and file_counts["wheels"] > 0 for file_counts in read
        ),
        "files_whose_motors_turn_wheels": sum(
            file_counts["wheels_driven"] > 0 for file_counts in read
        ),
        # of 24 November, before strangers' plans were an issue
        "listed_before": session.known().get("listed_before", {}),
        "listed": listed,
        "each": [{name: file_counts[name] for name in _COLUMNS} for file_counts in read],
    }
    session.write(summary)
