"""Starts of the virtual robots: where a robot is put, and where it is after one more second with
its motors held.

    python -m benchmarks resets

After a few random steps each robot is put at a start, its motors hold the angles that they have,
and a second passes. A start is at rest if the robot has turned by at most 2 degrees and moved by at
most 3 mm; of a robot on a fixed base every joint counts. Then a Walker is trained, and its falls in
200 evaluation episodes are counted. Takes ten minutes, most of it for the Walker.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

import bricksrl
from benchmarks.session import Session
from brickhub.virtual.machine import Machine
from bricksrl.envs import list_envs
from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train
from bricktwin.twin.mujoco_body import MujocoBody

MOST_DEG, MOST_MM = 2.0, 3.0
MOST_STEPS = 8
WALKER, TRAINED_EPISODES = "Walker-v1", 40


def hold(machine: Machine) -> None:
    """Hold all motors in use where they are, whatever they did before."""
    for servo in machine.servos.values():
        if servo.is_open:
            servo.update()  # reads the angle
            angle_mdeg = servo.observer.history[-1]
            servo.track_target(0)  # of a drive base, too, that moved it
            servo.observer.reset(angle_mdeg)
            servo.control.start_hold(machine.time_ticks, angle_mdeg)


def moved(body: MujocoBody, start: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Turn (degrees) and way (mm) since positions of all joints."""
    if not body.moves:
        return math.degrees(np.abs(body.data.qpos - start).max()), 0.0
    at, pose = body.base_address, body.data.qpos
    cosine = min(abs(float(pose[at + 3 : at + 7] @ start[at + 3 : at + 7])), 1.0)
    return math.degrees(2.0 * math.acos(cosine)), 1000.0 * float(
        np.linalg.norm((pose - start)[at : at + 3])
    )


def starts(env_id: str, count: int) -> dict[str, Any]:
    """How many of the starts are not at rest, and the largest turn and way."""
    torch.manual_seed(0)
    env, rng, ways = bricksrl.make(env_id, seed=0), np.random.default_rng(0), []
    for _ in range(count):
        state = env.reset()
        for _ in range(rng.integers(MOST_STEPS)):
            state["action"] = env.action_spec.rand()
            state = env.step(state)["next"]
            if state["done"].any():
                break
        body, machine = env.twin.body, env.twin.machine
        body.reset(rng)
        start = body.data.qpos.copy()
        hold(machine)
        machine.advance(1000)
        ways.append(moved(body, start))
    env.close()
    turns_deg, ways_mm = zip(*ways, strict=True)
    restless = sum(turn > MOST_DEG or way > MOST_MM for turn, way in ways)
    return {
        "starts": count,
        "restless": restless,
        "most_deg": round(max(turns_deg), 2),
        "most_mm": round(max(ways_mm), 2),
    }


def falls(episodes: int, evaluated: int) -> dict[str, Any]:
    """Falls of a trained Walker: episodes of its evaluation that end before their time."""
    with tempfile.TemporaryDirectory() as folder:
        run = train(
            TrainConfig(WALKER, "sac", episodes=episodes, seed=0, run_dir=Path(folder) / "run")
        ).run_dir
        result = evaluate(run, episodes=evaluated)
    return {
        "trained_episodes": episodes,
        "episodes": evaluated,
        "falls": sum(length < max(result.lengths) for length in result.lengths),
        "speed_m_s": round(result.metrics["forward_speed_m_s"], 4),
    }


def main(session: Session) -> None:
    """Put down all robots, train a Walker, and write."""
    virtual = [env_id for env_id in list_envs() if "Sim-" not in env_id]
    session.parser.add_argument("--starts", type=int, default=125, help="of each environment")
    session.parser.add_argument(
        "--episodes", type=int, default=200, help="of the Walker's evaluation; 0 for none"
    )
    args = session.parse()
    parts = {env_id: (env_id, args.starts) for env_id in virtual}
    found = dict(zip(parts, session.outcomes(starts, parts), strict=True))
    result: dict[str, Any] = {"environments": found}
    if args.episodes:
        (result["walker"],) = session.outcomes(falls, {"walker": (TRAINED_EPISODES, args.episodes)})
    session.write(result)
