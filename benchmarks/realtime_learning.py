"""Asynchronous learning in real time: wall time relative to the robot's motion, and number of
updates.

    python -m benchmarks realtime_learning --episodes 4

Trains each agent on `Walker-v0 --realtime` (100 steps of 250 ms per episode) with its default
settings. Motion is the duration of the same steps in simulated time, where the computer costs
nothing: the step and the two connection events of its command and its answer. Updates are counted
until the robot's last step; those after it are reported separately.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from bricksrl import make
from bricksrl.training import Callback, Phase, RunResult, TrainConfig, train

ENV = "Walker-v0"
AGENTS = ("sac", "td3", "crossq", "droq")


class Clock(Callback):
    """Callback that records the time of each step."""

    def __init__(self) -> None:
        self.at_s: dict[int, list[float]] = {}

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        self.at_s.setdefault(episode, []).append(time.perf_counter())

    def steps_s(self) -> list[float]:
        """Duration of each step except the first of each episode, without the initial random
        episode."""
        return [
            later - before
            for times in list(self.at_s.values())[1:]
            for before, later in pairwise(times)
        ]


def motion_s() -> float:
    """Mean duration of a step in simulated time."""
    env: Any = make(ENV, seed=0)
    times: list[float] = []
    state = env.reset()
    for _ in range(50):
        state["action"] = env.action_spec.rand()
        state = env.step_mdp(env.step(state))
        times.append(env.twin.now_s())
    env.close()
    return statistics.mean(later - before for before, later in pairwise(times))


def run(agent: str, episodes: int, motion: float) -> dict[str, Any]:
    """Train one agent, and compare its steps with their motion."""
    clock = Clock()
    cpu_s = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        config = TrainConfig(
            ENV, agent, episodes=episodes, realtime=True, record=False, run_dir=Path(folder) / "run"
        )
        result: RunResult = train(config, clock)
    cpu_s = time.process_time() - cpu_s
    steps = clock.steps_s()
    requested = (
        config.settings.updates_per_step if config.settings is not None and agent != "random" else 0
    )
    reached = result.updates_per_step
    return {
        "steps": len(steps),
        "wall_over_motion": round(sum(steps) / (len(steps) * motion), 4),
        "step_ms_median": round(1e3 * statistics.median(steps), 1),
        "step_ms_worst": round(1e3 * max(steps), 1),
        "updates_per_step_asked": requested,
        "updates_per_step_reached": None if reached is None else round(reached, 3),
        "ratio_off_by": None if reached is None else round(abs(1 - reached / requested), 4),
        "caught_up_after_the_run": result.caught_up,
        "cpu_s_of_the_robots_process": round(cpu_s, 1),
    }


def main(session: Session) -> None:
    """Measure all and write the results."""
    parser = session.parser
    parser.add_argument("--agents", nargs="+", default=list(AGENTS))
    args = session.parse(episodes=4)
    motion = motion_s()
    agents: dict[str, Any] = {}
    for agent in args.agents:
        agents[agent] = run(agent, args.episodes, motion)
        print(agent, agents[agent], flush=True)
    setup = {
        "environment": ENV,
        "episodes": args.episodes,
        "motion_ms_per_step": round(1e3 * motion, 1),
    }
    session.write({**setup, "agents": agents})
