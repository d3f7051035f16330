"""Walkers of different legs: what each of `examples/walkers` learns within two minutes.

    python -m benchmarks walkers
    python -m benchmarks walkers --plans ev3_six_legs

Each seed searches by the agent `gait`, for the steps that two minutes of the robot have. The gait
that it keeps is evaluated in two episodes: its speed, the largest tilt, and how often it falls. A
hub without an IMU does not notice its fall, so tilt and falls are those of the body. Other walkers
stay in the result.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from tensordict.nn import TensorDictModule

from benchmarks.session import Session
from bricksrl.agents.search.gait import PolicySearch
from bricksrl.training import TrainConfig, train
from bricksrl.training.callbacks import Callback
from bricktwin.plans.plan import read_plan
from bricktwin.twin.models.balance import plan_balance

FOLDER = Path(__file__).parent.parent / "examples" / "walkers"
ROBOT_S = 120
"""Time of the robot in which it learns."""
EPISODES = 2
SEED = 4711
FIRST_SEED = 0
FALLEN_DEG = 60.0
"""Tilt of a body that has fallen over."""


class Watch(Callback):
    """Callback that counts falls, and keeps the learner."""

    def __init__(self) -> None:
        self.falls = 0
        self.learner: Any = None
        self._env: Any = None

    def on_env(self, env: Any) -> None:
        self._env = env

    def on_learner(self, learner: Any) -> None:
        self.learner = learner

    def on_transition(self, _episode: int, _step: int, _phase: Any, _transition: Any) -> None:
        self.falls += tilt_deg(self._env) > FALLEN_DEG


def tilt_deg(env: Any) -> float:
    """Pitch or roll of a virtual robot's body, the larger one."""
    pitch_deg, roll_deg = env.twin.body.tilt_deg()
    return float(max(abs(pitch_deg), abs(roll_deg)))


def task_of(plan: Path) -> str:
    """The task of a walker: to walk forward."""
    return f"{plan}:walk"


def evaluated(env_id: str, policy: Any) -> dict[str, float]:
    """Mean speed of a policy in episodes of its own, the largest tilt, and how many of them ended
    in a fall."""
    import bricksrl
    from bricksrl.envs.rollout import play_episodes

    env = bricksrl.make(env_id, seed=SEED)
    tilts_deg: list[float] = []

    def watched(state: Any) -> Any:
        tilts_deg.append(tilt_deg(env))
        return policy(state)

    speeds_m_s = []
    falls = 0
    for episode in play_episodes(env, watched, EPISODES, SEED):
        speeds_m_s.append(episode.metrics["forward_speed_m_s"])
        falls += tilt_deg(env) > FALLEN_DEG
    env.close()
    return {
        "speed_m_s": round(sum(speeds_m_s) / EPISODES, 4),
        "tilt_deg": round(max(tilts_deg), 1),
        "falls": falls,
    }


def search(plan: Path, seed: int) -> dict[str, Any]:
    """What one seed finds: the speed of its gait, its falls, and its numbers."""
    import bricksrl

    env = bricksrl.make(task_of(plan), seed=seed)
    task = env.task
    env.close()
    episode_s = task.max_steps * task.interface.settle.fixed_ms / 1000
    watch = Watch()
    with tempfile.TemporaryDirectory() as parent:
        config = TrainConfig(
            task_of(plan),
            "gait",
            # Whole episodes, and no more than the time allows.
            episodes=int(ROBOT_S / episode_s),
            seed=seed,
            record=False,
            run_dir=Path(parent) / "run",
        )
        made = train(config, watch).episodes[-1].steps
    learner: PolicySearch = watch.learner
    actor = TensorDictModule(learner.actor, ["observation"], ["action"])
    names = [entry.name for entry in learner.search.entries]
    best = {name: round(value, 3) for name, value in zip(names, learner.search.best, strict=True)}
    return {
        "seed": seed,
        "steps": made,
        "falls_in_training": watch.falls,
        **evaluated(task_of(plan), actor),
        "best": best,
    }


def described(path: Path) -> dict[str, Any]:
    """What a plan weighs, and how it stands."""
    plan = read_plan(path)
    balance = plan_balance(plan)
    assert balance is not None
    return {
        "parts": len(plan.parts),
        "mass_g": round(plan.mass_g),
        "centre_mm": round(balance.height_mm),
        "inside_mm": round(balance.inside_mm),
        "largest_tilt_deg": round(balance.largest_tilt_deg),
    }


def main(session: Session) -> None:
    """Measure, and write."""
    files = {plan.stem: plan for plan in sorted(FOLDER.glob("*.ldr"))}
    args = session.parse(plans=list(files), seeds=5)
    plans = [files[name] for name in args.plans]
    seeds = range(FIRST_SEED, FIRST_SEED + args.seeds)
    parts = {f"{plan.stem}-{seed}": (plan, seed) for plan in plans for seed in seeds}
    found = list(session.outcomes(search, parts))
    known: dict[str, Any] = session.known().get("walkers", {})
    for number, plan in enumerate(plans):
        own = found[number * args.seeds : (number + 1) * args.seeds]
        speeds_m_s = [one["speed_m_s"] for one in own]
        known[plan.stem] = {
            **described(plan),
            "least_m_s": min(speeds_m_s),
            "mean_m_s": round(sum(speeds_m_s) / len(own), 4),
            "falls": sum(one["falls"] for one in own),
            "seeds": own,
        }
    walkers = {name: known[name] for name in files if name in known}
    session.write({"robot_s": ROBOT_S, "episodes": EPISODES, "walkers": walkers})
