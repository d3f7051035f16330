"""Differentials, and several motors on one gear: their twins share turns as gears do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bricktwin.plans.mechanism.open_gears import turns_with
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.twin.models.linkage import Linkage
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

UPRIGHT = "0 -1 0 1 0 0 0 0 1"
FLAT = "1 0 0 0 0 1 0 -1 0"
ACROSS = "1 0 0 0 0 -1 0 1 0"
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)
FULL_MV = 9000


def motors(folder: Path, *lines: str) -> Path:
    """A plan of a hub and two motors in a row, each with an upright axle, and further parts."""
    parts = ["1 15 160 60 10 1 0 0 0 0 1 0 -1 0 67718.dat"]
    for port, x in (("A", 0), ("B", 60)):
        parts += [
            f"0 !BRICKSRL PORT {port}",
            f"1 15 {x} 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
            f"1 0 {x} -80 0 {UPRIGHT} 3706.dat",
        ]
    parts += [f"1 0 {x} {y} 20 {ACROSS} 2780.dat" for x in (30, 90) for y in (20, -20)]
    path = folder / f"geared_{len(lines)}.ldr"
    path.write_text("\n".join([*parts, *lines]) + "\n", encoding="utf-8")
    return path


def gears_of_24(folder: Path) -> Path:
    """Two motors whose gears mesh."""
    return motors(folder, *(f"1 7 {x} -80 0 {FLAT} 3648b.dat" for x in (0, 60)))


def differential(folder: Path) -> Path:
    """Motor A turns the lower shaft of a differential, motor B its housing; nothing but these the
    upper one."""
    return motors(
        folder,
        f"1 7 60 -126 0 {FLAT} 18575.dat",
        f"1 7 0 -150 -36.3 {FLAT} 62821b.dat",
        "1 7 0 -133 0 1 0 0 0 0 -1 0 1 0 6589.dat",
        f"1 7 0 -167 0 {FLAT} 6589.dat",
        "1 7 17 -150 0 0 0 -1 0 1 0 1 0 0 6589.dat",
        f"1 0 0 -200 0 {UPRIGHT} 3705.dat",
        f"1 7 0 -220 0 {FLAT} 3648b.dat",
    )


def body(path: Path) -> MujocoBody:
    """A twin without backlash and noise."""
    return MujocoBody(robot_as_drawn(path).robot, OPEN_FLOOR, QUIET, 0)


def turned_deg(one: MujocoBody, number: str) -> float:
    """Turn of the body with a part of this number about the upright axis, whole turns too."""
    return float(np.degrees(one.data.joint(number).qpos[0]))


def test_x(tmp_path):
    path = differential(tmp_path)
    p = planned_robot(path)
    a = p.articulation
    for l in a.bodies: print([p.plan.parts[q].part.number for q in l.parts])
    for j in a.joints: print(j.parent, j.child, j.axis)
    print(a.couplings, a.loops)
    one = body(path)
    for va, vb in ((0, 9000), (9000, 0), (9000, 9000), (9000,-9000)):
        one = body(path)
        one.set_voltage("A", va); one.set_voltage("B", vb)
        for t in (1000,5000):
            one.advance_to(t)
            print(va, vb, one.angle_mdeg("A")/1000, one.angle_mdeg("B")/1000, {one.model.joint(j).name: round(float(np.degrees(one.data.qpos[one.model.jnt_qposadr[j]]))) for j in range(one.model.njnt)})
    from bricktwin.plans.check import check
    from bricktwin.plans.plan import read_plan
    for f in check(read_plan(path)): print(f)
    path = gears_of_24(tmp_path)
    for va, vb in ((0, 9000), (9000, 0), (9000, 9000), (9000,-9000)):
        one = body(path)
        one.set_voltage("A", va); one.set_voltage("B", vb)
        for t in (1000,5000):
            one.advance_to(t)
            print(va, vb, one.angle_mdeg("A")/1000, one.angle_mdeg("B")/1000)
