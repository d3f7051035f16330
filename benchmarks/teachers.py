"""Teachers: SAC on the Walker that starts from a gait, as a base that it adds to or as
demonstrations that it imitates first.

    python -m benchmarks teachers

Each seed searches a gait for 300 robot steps, and goes on with SAC for 1,000; before the first of
them and after each episode its best actions are evaluated in the same episodes as the gait.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.gait import STEPS, WALKER, evaluated
from benchmarks.session import Session
from bricksrl.training import TrainConfig, train
from bricksrl.training.callbacks import Callback

WAYS: dict[str, tuple[str, ...]] = {
    "demonstrations": ("demonstrations",),
    "base": ("base",),
    "alone": (),
}
"""Fields of the configuration that name the gait's run."""
EPISODE = 100
"""Steps of an episode."""


class Evaluations(Callback):
    """Callback that evaluates the best actions before the run and after each episode."""

    def __init__(self) -> None:
        self.returns: list[float] = []
        self.cpu_s = 0.0
        self.learner: Any = None

    def on_learner(self, learner: Any) -> None:
        self.learner = learner

    def on_start(self, *_: Any) -> None:
        self._evaluate()

    def on_episode(self, *_: Any) -> None:
        self.cpu_s += time.process_time() - self._went_on_s
        self._evaluate()

    def _evaluate(self) -> None:
        self.returns.append(round(evaluated(WALKER, self.learner.exploit)["return"], 2))
        self._went_on_s = time.process_time()


def taught(way: str, seed: int, episodes: int) -> dict[str, Any]:
    """SAC's evaluations with a gait as teacher, and the gait's return."""
    with tempfile.TemporaryDirectory() as parent:
        gait, own = Path(parent) / "gait", Path(parent) / "run"
        given: dict[str, Any] = {name: str(gait) for name in WAYS[way]}
        config = TrainConfig(WALKER, "sac", episodes, seed, record=False, run_dir=own, **given)
        teacher, evaluations = Evaluations(), Evaluations()
        train(TrainConfig(WALKER, "gait", STEPS // EPISODE, seed, run_dir=gait), teacher)
        run = train(config, evaluations)
        returns = evaluations.returns
    return {
        "way": way,
        "seed": seed,
        "gait": teacher.returns[-1],
        "returns": returns,
        "explored": [round(episode.return_, 1) for episode in run.episodes],
        "falls": sum(episode.length < EPISODE for episode in run.episodes),
        "cpu_s": round(evaluations.cpu_s, 1),
        "least_of_gait": round(min(returns) / teacher.returns[-1], 3),
        "last_of_gait": round(returns[-1] / teacher.returns[-1], 3),
    }


def main(session: Session) -> None:
    """Measure, and write."""
    args = session.parse(seeds=5, episodes=10, ways=list(WAYS))
    parts = {
        f"{way}-{seed}-{args.episodes}": (way, seed, args.episodes)
        for way in args.ways
        for seed in range(args.seeds)
    }
    session.write({"env": WALKER, "runs": list(session.outcomes(taught, parts))})
