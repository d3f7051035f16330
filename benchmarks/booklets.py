"""Booklets, tested by building from them: what each step shows, how many parts it has, whether they
can be put on in its order.

    python -m benchmarks booklets [PLAN ...]

Each step is drawn with and without the other parts: of each of its parts, at least a quarter must
be seen in its picture or its inset. Its parts come from outside, in its order, along straight
paths, and hold on what is there. ``booklet_cpu_s`` is the CPU time of ``bricktwin plan steps`` on
one core, from its start to the PDF.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.session import Session
from bricktwin.plans.booklet.instructions import (
    MAX_KINDS,
    MAX_PIECES,
    MIN_VISIBLE,
    Instruction,
    instructions,
    kind_of,
)
from bricktwin.plans.booklet.picture import Picture, Studio
from bricktwin.plans.building import Occupancy
from bricktwin.plans.connections import connections, neighbours, reached
from bricktwin.plans.plan import Plan, read_plan

PLANS = Path(__file__).parents[1] / "packages/bricktwin/src/bricktwin/robots/plans"
OURS = ("two_wheeler", "walker", "robo_arm", "ev3_driver")
EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.ldr"))
_PATH_LDU = (4.0, 8.0, 12.0, 16.0, 20.0, 30.0, 40.0, 60.0, 90.0, 130.0, 170.0)
_ZOOM = 1.0
"""Points per LDU at which the visible shares are measured."""


def shares(pictures: list[Picture], step: Instruction) -> list[float]:
    """The visible share of each item of a step, in the picture that shows it best."""
    return [
        max(picture.visible(item) for picture in pictures if item[0] in picture.alone)
        for item in step.items
    ]


def without_way(plan: Plan, step: Instruction, occupancy: Occupancy) -> int:
    """Number of parts of a step that cannot be put on from outside in its order."""
    present, failed = np.zeros(len(plan.parts), dtype=bool), 0
    present[list(step.before)] = True
    for move in step.moves:
        if present.any():
            is_free = all(
                occupancy.is_free(move.parts, present, move.outward * distance)
                for distance in _PATH_LDU
            )
            failed += 0 if move.outward.any() and is_free else len(move.items)
        present[move.parts] = True
    return failed


def booklet_cpu_s(path: Path) -> float:
    """CPU time of a process that draws the booklet of a plan, seconds."""
    before = os.times()
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "booklet.pdf")
        command = [sys.executable, "-m", "bricktwin", "plan", "steps", str(path), "--out", out]
        one_core = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run(command, check=True, capture_output=True, env=one_core)  # noqa: S603
    after = os.times()
    user_s = after.children_user - before.children_user
    return user_s + after.children_system - before.children_system


def look(path: Path) -> dict[str, Any]:
    """Counts of the booklet of one plan."""
    started_s = time.process_time()
    plan, studio = read_plan(path), Studio()
    steps, occupancy, links = (
        list(instructions(plan, studio)),
        Occupancy(plan.parts),
        connections(plan.parts),
    )
    planned_s = time.process_time() - started_s
    seen, too_many, way, loose = [], 0, 0, 0
    for step in steps:
        scenes = [scene for scene in (step.scene, step.inset) if scene is not None]
        seen += shares([studio.picture(scene.shown, scene.view, _ZOOM) for scene in scenes], step)
        kinds = {kind_of(plan, item, len(step.assembly)) for item in step.items}
        too_many += len(step.items) > MAX_PIECES or len(kinds) > MAX_KINDS
        way += without_way(plan, step, occupancy)
        after = step.before | {part for move in step.moves for part in move.parts}
        graph = neighbours([link for link in links if link.male in after and link.female in after])
        loose += len((after - step.before) - reached([min(after)], graph)) if len(after) > 1 else 0
    return {
        "parts": len(plan.parts),
        "steps_of_author": len(plan.steps),
        "steps": len(steps),
        "items": len(seen),
        "items_below_a_quarter": sum(share < MIN_VISIBLE for share in seen),
        "smallest_share": round(min(seen), 2),
        "insets": sum(step.inset is not None for step in steps),
        "turned_views": sum(step.is_turned for step in steps),
        "steps_above_the_limits": too_many,
        "items_without_a_way": way,
        "parts_that_hold_on_nothing": loose,
        "cpu_s": round(planned_s, 1),
        "booklet_cpu_s": round(booklet_cpu_s(path), 1),
    }


def main(session: Session) -> None:
    """Build from the booklets of all plans and write the counts."""
    session.parser.add_argument(
        "plans", nargs="*", help="names of our plans, or files; ours by default"
    )
    counts = {}
    for name in session.parse().plans or (*OURS, *EXAMPLES):
        path = PLANS / f"{name}.ldr" if name in OURS else Path(name)
        counts[path.stem] = look(path)
        print(path.stem, counts[path.stem], flush=True)
    session.write({"plans": counts})
