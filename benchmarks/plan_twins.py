"""Twins that follow from the plans beside those that are written by hand: masses, wheel paths, feet, ranges, returns, speed.

    python benchmarks/plan_twins.py

One process, one thread, about five minutes. The returns are those of ``baselines.py``, on the same tasks with the other twin.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import baselines
import mujoco
import numpy as np
import torch
from machine import command, write
from numpy.typing import NDArray
from scripted import CONTROLLERS

import bricksrl
from bricksrl import robots
from bricksrl.envs import get_task, register
from bricksrl.plans.mechanism.end_stops import free_deg
from bricksrl.plans.planned_robot import planned_robot
from bricksrl.robots import Robot
from bricksrl.twin.mujoco_body import MujocoBody
from bricksrl.twin.physics import Physics
from bricksrl.twin.scene import OPEN_FLOOR

PLANS = Path(__file__).parents[1] / "plans"
NAMES = {"two-wheeler": "two_wheeler", "walker": "walker", "robo-arm": "robo_arm"}
TASKS = ("RunAway-v0", "Spinning-v0", "Walker-v0", "Walker-v1", "RoboArm-v0")
HANDS = {"two-wheeler": "two_wheeler", "walker": "walker", "robo-arm": "robo_arm"}
Floats = NDArray[np.float64]


def versions(robot: Robot) -> dict[str, Robot]:
    """The robot with either model."""
    name = NAMES[robot.name]
    return {
        "by_hand": replace(robot, model=f"bricksrl.twin.models.{HANDS[robot.name]}:build"),
        "from_plan": replace(robot, model=str(PLANS / f"{name}.ldr")),
    }


def body_of(robot: Robot) -> MujocoBody:
    """A twin without play, so that both stand alike."""
    return MujocoBody(robot, OPEN_FLOOR, Physics(backlash_deg=0.0), 0)


def masses(body: MujocoBody) -> dict[str, Any]:
    """Mass, centre of mass (mm, from the hub) and inertia about it (kg cm2) of the whole robot as it stands."""
    model, data = body.model, body.data
    mujoco.mj_forward(model, data)
    mass = float(model.body_mass.sum())
    centre = (model.body_mass[:, None] * data.xipos).sum(axis=0) / mass
    inertia = np.zeros((3, 3))
    for index in range(model.nbody):
        turn = data.ximat[index].reshape(3, 3)
        away = data.xipos[index] - centre
        inertia += turn @ np.diag(model.body_inertia[index]) @ turn.T
        inertia += model.body_mass[index] * (float(away @ away) * np.eye(3) - np.outer(away, away))
    from_hub = (centre - data.site("imu").xpos) * 1000
    return {
        "mass_kg": round(mass, 4),
        "centre_from_hub_mm": np.round(from_hub, 1).tolist(),
        "inertia_kg_cm2": np.round(np.diag(inertia) * 1e4, 2).tolist(),
    }


def drive(robot: Robot, left_mv: int, right_mv: int) -> list[list[float]]:
    """Way of the 2Wheeler: x, y (mm) and heading (deg) every 0.5 s."""
    body = body_of(robot)
    found = []
    for step in range(1, 7):
        body.set_voltage("E", left_mv)
        body.set_voltage("A", right_mv)
        body.advance_to(500 * step)
        pose = body.pose()
        found.append([round(1000 * pose.x_m, 1), round(1000 * pose.y_m, 1), round(pose.heading_deg, 1)])
    return found


def foot_path(robot: Robot, port: str) -> tuple[Floats, Floats]:
    """Way of the foot that a motor moves, in the air: angles of the shaft (deg, 0..360) and places [n, 3] in the chassis, m."""
    body = body_of(robot)
    model, data = body.model, body.data
    model.opt.gravity[:] = 0.0
    data.qpos[2] = 1.0
    mujoco.mj_forward(model, data)
    joint = model.joint(f"motor_{port}")
    chassis, crank = model.body("chassis").id, data.body(f"rotor_{port}")
    feet = [index for index in range(model.ngeom) if model.geom(index).name.startswith("foot_")]
    foot = min(feet, key=lambda index: float(np.linalg.norm(data.geom_xpos[index][:2] - crank.xpos[:2])))
    angles, places = [], []
    body.set_voltage(port, 2500)
    for step in range(1, 900):
        body.advance_to(5 * step)
        mujoco.mj_kinematics(model, data)
        frame = data.xmat[chassis].reshape(3, 3)
        angles.append(math.degrees(float(data.qpos[joint.qposadr[0]])))
        places.append((data.geom_xpos[foot] - data.xpos[chassis]) @ frame)
        if abs(angles[-1]) > 370:
            break
    return np.array(angles), np.array(places)


def feet(robot: Robot) -> dict[str, Any]:
    """How far the ways of all four feet lie apart, forward and up, over a turn of the crank; and their places across."""
    found: dict[str, Any] = {}
    grid = np.arange(5.0, 365.0, 5.0)
    for motor in robot.motors:
        ways = {}
        for name, version in versions(robot).items():
            angles, places = foot_path(version, motor.port)
            heights = np.stack([np.interp(grid, np.abs(angles), places[:, axis]) for axis in range(3)], axis=1)
            ways[name] = heights - np.array([0.0, 0.0, 0.0])
        apart = np.linalg.norm((ways["by_hand"] - ways["from_plan"])[:, [0, 2]], axis=1) * 1000
        found[motor.name] = {
            "apart_mm": {"mean": round(float(apart.mean()), 3), "most": round(float(apart.max()), 3)},
            "across_mm": {name: round(float(way[:, 1].mean()) * 1000, 1) for name, way in ways.items()},
            "stride_mm": {name: round(float(np.ptp(way[:, 0])) * 1000, 1) for name, way in ways.items()},
            "lift_mm": {name: round(float(np.ptp(way[:, 2])) * 1000, 1) for name, way in ways.items()},
        }
    return found


def ranges(robot: Robot) -> dict[str, Any]:
    """End stops of the RoboArm's motors, and how far the plan's parts let them turn."""
    planned = planned_robot(PLANS / f"{NAMES[robot.name]}.ldr")
    found: dict[str, Any] = {}
    for motor in robot.motors:
        if motor.range_deg is None:
            continue
        stops = {}
        for name, version in versions(robot).items():
            model = body_of(version).model
            gear = float(model.actuator(f"motor_{motor.port}").gear[0])
            stops[name] = [round(value) for value in sorted(np.degrees(model.joint(f"motor_{motor.port}").range) * gear)]
        free = free_deg(planned, motor.port, motor.range_deg[0] - 180.0, motor.range_deg[1] + 180.0)
        found[motor.name] = {"described": list(motor.range_deg), **stops, "parts_meet_at": [round(free[0]), round(free[1])]}
    return found


def speed(robot: Robot) -> dict[str, float]:
    """How many times faster than real time the physics are, all motors on, by the processor's time; the best of three."""
    found = {}
    for name, version in versions(robot).items():
        best = 0.0
        for _ in range(3):
            body = body_of(version)
            for motor in robot.motors:
                body.set_voltage(motor.port, 2500 if motor.range_deg is None else 0)
            started_s = time.process_time()
            body.advance_to(6000)
            best = max(best, 6.0 / (time.process_time() - started_s))
        found[name] = round(best, 1)
    return found


def returns(env_id: str, episodes: int) -> dict[str, Any]:
    """Random and scripted controllers on both twins."""
    found: dict[str, Any] = {}
    task = get_task(env_id)
    for name, version in versions(task.robot).items():
        own = replace(task, id=f"{env_id.rpartition('-')[0]}{name.title().replace('_', '')}-v0", robot=version)
        register(own)
        size = len(task.interface.commands)
        found[name] = {
            "random": baselines.measure(own.id, lambda _state, size=size: 2.0 * torch.rand(size) - 1.0, episodes),  # type: ignore[misc]
            "scripted": baselines.measure(own.id, CONTROLLERS[env_id], max(episodes // 3, 5)),
        }
    for policy in ("random", "scripted"):
        low, high = found["by_hand"][policy]["return_interval"]
        other_low, other_high = found["from_plan"][policy]["return_interval"]
        found[f"{policy}_intervals_overlap"] = bool(other_low <= high and low <= other_high)
    return found


def main() -> None:
    """Measure and write."""
    parser = command(__doc__)
    parser.add_argument("--episodes", type=int, default=15)
    parser.add_argument("--tasks", nargs="*", default=list(TASKS), choices=TASKS)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    assert bricksrl.__version__
    table: dict[str, Any] = {}
    for name in NAMES:
        robot = robots.get(name)
        table[name] = {key: masses(body_of(version)) for key, version in versions(robot).items()}
        table[name]["times_real_time"] = speed(robot)
        print(name, table[name], flush=True)
    wheeler = versions(robots.TWO_WHEELER)
    table["two-wheeler"]["paths"] = {
        way: {name: drive(version, *voltages) for name, version in wheeler.items()}
        for way, voltages in {"straight": (-5000, 5000), "curve": (-5000, 3000), "turn": (5000, 5000)}.items()
    }
    table["walker"]["feet"] = feet(robots.WALKER)
    table["robo-arm"]["ranges"] = ranges(robots.ROBO_ARM)
    print(table, flush=True)
    table["returns"] = {env_id: returns(env_id, chosen.episodes) for env_id in chosen.tasks}
    print(write("plan_twins", table))


if __name__ == "__main__":
    main()
