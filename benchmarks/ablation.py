"""Ablation of the default settings: each set back, one at a time, to the paper's value.

    python -m benchmarks ablation

An agent trains in a simulation with the default preset, with the paper's, and with the default one in which a single setting is
the paper's, for `STEPS` robot steps in total. Means over the seeds of ``EVALUATED_EPISODES`` deterministic episodes, with 95 %
bootstrap intervals over the seeds; all variants use the same seeds. Earlier results of other agents stay in the result.
"""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from benchmarks.stopping import StopWhen
from bricksrl.agents import AGENTS, preset
from bricksrl.agents.settings import Settings
from bricksrl.training import TrainConfig, train

STEPS = {"WalkerSim-v0": 1000, "RoboArmSim-v0": 400}
EVALUATED_EPISODES = 40
FOR_GOALS = ("goals", "hindsight", "new_goals")
"""Settings without effect in a task without goals."""
FOR_IMAGES = ("encoder",)
"""Settings without effect in a task without images, as all of these are."""


def variants(env: str, agent: str) -> dict[str, Settings]:
    """Settings by variant: default, default with one value of the paper, paper."""
    default, paper = preset("default", agent), preset("paper", agent)
    settings: dict[str, Settings] = {"default": default}
    for name, value in asdict(paper).items():
        without_effect = FOR_IMAGES + FOR_GOALS * (env == "WalkerSim-v0")
        if value != getattr(default, name) and name not in without_effect:
            settings[name] = replace(default, **{name: value})
    return {**settings, "paper": paper}


def run(env: str, agent: str, variant: str, steps: int, seed: int) -> tuple[float, float | None]:
    """Return and success of one agent after its training."""
    from bricksrl.evaluation import evaluate

    observer = StopWhen(lambda episode: episode.steps >= steps)
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        settings = variants(env, agent)[variant]
        config = TrainConfig(env, agent, steps, seed, settings=settings, record=False, run_dir=folder)
        train(config, observer, stop=observer.stop)
        result = evaluate(folder, episodes=EVALUATED_EPISODES, save=False)
    return result.return_mean, result.success_rate


def summary(outcomes: list[tuple[float, float | None]]) -> dict[str, Any]:
    """Summary over the seeds."""
    from bricksrl.evaluation.statistics import mean, stratified_bootstrap_interval

    returns, successes = [value for value, _ in outcomes], [success for _, success in outcomes if success is not None]
    interval = stratified_bootstrap_interval([returns], mean)
    return {
        "return_mean": round(statistics.fmean(returns), 2),
        "return_interval": [round(interval.low, 2), round(interval.high, 2)],
        "success_mean": round(statistics.fmean(successes), 3) if successes else None,
        "returns": [round(value, 2) for value in returns],
    }


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--envs", nargs="+", default=list(STEPS), choices=list(STEPS))
    parser.add_argument("--agent", default="sac", choices=AGENTS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--only", nargs="+", help="variants to train")
    parser.add_argument("--steps", type=int, help="robot steps, in place of those of each environment")
    args = session.parse()
    cells = {
        f"{env}-{args.agent}-{name}-{steps}": (env, args.agent, name, steps)
        for env in args.envs
        for steps in (args.steps or STEPS[env],)
        for name in variants(env, args.agent)
        if args.only is None or name in args.only
    }
    known: dict[str, Any] = session.known().get("environments", {})
    for env in args.envs:
        known.setdefault(env, {})[args.agent] = {"steps": args.steps or STEPS[env], "variants": {}}
    for (env, agent, name, _), runs in zip(cells.values(), session.by_seed(run, cells, args.seeds).values(), strict=True):
        values = asdict(variants(env, agent)[name])
        setting = values if name in ("default", "paper") else {name: values[name]}
        known[env][agent]["variants"][name] = {"setting": setting, **summary(runs)}
    session.write({"evaluated_episodes": EVALUATED_EPISODES, "environments": known})
