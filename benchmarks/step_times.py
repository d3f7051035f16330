"""Streamed steps: gaits by the time of a step, with an exchange for each or streamed, and what SAC
finds in five minutes.

    python -m benchmarks step_times

All over the default link. A gait is searched as in `benchmarks.worlds`, which has the other links;
the time that a step really takes is that of its evaluation. SAC learns Walker-v2 from nothing, in
streamed steps of 100 ms. Its time is what the robot walked and, with resets, what the hub's clock
says, which includes the start of the program and the placing.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.gait import SEED, WALKER, evaluated
from benchmarks.session import Session
from benchmarks.worlds import SEARCH_MS, SETTLE_MS, STEPS_MS, TRIAL_MS
from bricksrl.agents import preset
from bricksrl.envs.env_interface import interface_of
from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train
from bricksrl.training.callbacks import Callback

WAYS = {"lock-step": False, "streaming": True}
STREAMED, EPISODES, EPISODE_MS = "Walker-v2", 12, 25_000
"""What SAC learns; episodes of that, five minutes; time of an episode."""


def searched(step_ms: int, streaming: bool) -> dict[str, Any]:
    """A gait that was searched with steps of that time."""
    settings = replace(
        preset("default", "gait"),
        trial_steps=TRIAL_MS // step_ms,
        settle_steps=SETTLE_MS // step_ms,
    )
    options: dict[str, Any] = {"options": {"step_ms": step_ms}, "streaming": streaming}
    with tempfile.TemporaryDirectory() as parent:
        run = Path(parent) / "run"
        train(
            TrainConfig(
                WALKER,
                "gait",
                SEARCH_MS // EPISODE_MS,
                settings=settings,
                record=False,
                run_dir=run,
                **options,
            )
        )
        found = evaluate(run, episodes=2, seed=SEED, save=False)
    speed_m_s, forward_m = (found.metrics[name] for name in ("forward_speed_m_s", "forward_m"))
    really_ms = round(1000 * forward_m / speed_m_s / (EPISODE_MS // step_ms), 1)
    return {
        "step_ms": step_ms,
        "streaming": streaming,
        "really_ms": really_ms,
        "speed_m_s": round(speed_m_s, 4),
    }


class Clock(Callback):
    """Callback that adds up the hub's clock, which begins anew with each episode, and evaluates the
    best actions after the last two."""

    def __init__(self) -> None:
        self.walked_s = self.with_resets_s = 0.0
        self.marks: list[dict[str, float]] = []
        self.env: Any = None
        self.learner: Any = None

    def on_env(self, env: Any) -> None:
        self.env = interface_of(env)

    def on_learner(self, learner: Any) -> None:
        self.learner = learner

    def on_episode(self, episode: Any, _: Any) -> None:
        self.walked_s += episode.measures["forward_m"] / episode.measures["forward_speed_m_s"]
        self.with_resets_s += self.env.twin.now_s()
        if episode.episode > EPISODES - 2:
            found = evaluated(STREAMED, self.learner.exploit)
            times = {
                "walked_s": round(self.walked_s, 1),
                "with_resets_s": round(self.with_resets_s, 1),
            }
            self.marks.append(
                {"steps": episode.steps, **times, "speed_m_s": round(found["speed_m_s"], 4)}
            )


def learned(seed: int) -> dict[str, Any]:
    """SAC from nothing."""
    clock = Clock()
    with tempfile.TemporaryDirectory() as parent:
        train(
            TrainConfig(
                STREAMED, "sac", EPISODES, seed, record=False, run_dir=Path(parent) / "run"
            ),
            clock,
        )
    return {"seed": seed, "marks": clock.marks}


def main(session: Session) -> None:
    """Measure, and write."""
    session.parser.add_argument("--steps-ms", type=int, nargs="*", default=list(STEPS_MS))
    session.parser.add_argument("--seeds", type=int, default=5)
    args = session.parse()
    gaits = {
        f"gait-{step_ms}-{way}": (step_ms, WAYS[way]) for way in WAYS for step_ms in args.steps_ms
    }
    found = list(session.outcomes(searched, gaits))
    runs = list(session.outcomes(learned, {f"sac-{seed}": (seed,) for seed in range(args.seeds)}))
    session.write({"gaits": found, "sac": runs})
