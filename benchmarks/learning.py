"""Learning speed in the simulations: return and success over robot steps, CPU time and wall time.

    python -m benchmarks learning --agents sac td3 --seeds 10 --episodes 25

Initial episodes of random actions are included. Each run pauses at each mark, at the end of the
episode that reaches it, is evaluated there on ``EVALUATED_EPISODES`` deterministic episodes, and is
resumed from its checkpoint, bit for bit. One process per core, with one thread each. Intervals are
95 % bootstrap intervals of the mean over the seeds. A picture next to the JSON file shows the
return over robot steps, CPU time and wall time. Earlier results of other agents and environments
stay in both.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from benchmarks.stopping import StopWhen
from bricksrl.agents import AGENTS
from bricksrl.training import Episode, TrainConfig, resume, train
from bricksrl.training.config import settings_for

LENGTH = 100
"""Maximum number of steps of an episode, in all of these environments."""
MARKS = {
    "WalkerSim-v0": (300, 500, 1000, 1500, 2000, 2500, 5000, 7500),
    "WalkerSim-v1": (300, 500, 1000, 1500, 2000, 2500, 5000, 7500),
    "RoboArmSim-v0": (100, 250, 500, 750, 1000, 2000, 4000),
}
EVALUATED_EPISODES, ON_TWIN = 40, 5
"""Episodes of an evaluation, and those on a virtual robot, which takes longer and varies less."""


def has_made(count: int, unit: str, episode: Episode) -> bool:
    """Whether a run has made this number of robot steps or episodes."""
    return int(getattr(episode, unit)) >= count


def run(
    env: str,
    agent: str,
    preset_name: str,
    marks: Sequence[int],
    unit: str,
    changes: Mapping[str, Any],
    seed: int,
) -> list[dict[str, Any]]:
    """Train one agent, whose settings are the preset's with these changes, from mark to mark,
    numbers of "steps" or of the "episode"; returns its evaluation and the training time at each."""
    from bricksrl.evaluation import evaluate

    results: list[dict[str, Any]] = []
    cpu_s = wall_s = 0.0
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        for mark in marks:
            callback = StopWhen(partial(has_made, mark, unit))
            started = time.process_time(), time.perf_counter()
            if results:
                result = resume(folder, callback, stop=callback.stop)
            else:
                settings = replace(settings_for(env, preset_name, agent), **changes)
                config = TrainConfig(
                    env, agent, marks[-1], seed, settings=settings, record=False, run_dir=folder
                )
                result = train(config, callback, stop=callback.stop)
            cpu_s, wall_s = (
                cpu_s + time.process_time() - started[0],
                wall_s + time.perf_counter() - started[1],
            )
            outcome = evaluate(
                folder, episodes=EVALUATED_EPISODES if "Sim" in env else ON_TWIN, save=False
            )
            last = result.episodes[-1]
            results.append(
                {
                    "mark": mark,
                    "steps": last.steps,
                    "episodes": last.episode,
                    "return": round(outcome.return_mean, 2),
                    "success_rate": outcome.success_rate,
                    "cpu_s": round(cpu_s, 1),
                    "wall_s": round(wall_s, 1),
                }
            )
    return results


def summary(runs: list[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Summary over the seeds at each mark."""
    from bricksrl.evaluation.statistics import mean, stratified_bootstrap_interval

    summaries = []
    for at_mark in zip(*runs, strict=True):
        returns = [float(run["return"]) for run in at_mark]
        interval = stratified_bootstrap_interval([returns], mean)
        means = {
            key: sum(run[key] for run in at_mark) / len(at_mark)
            for key in ("steps", "episodes", "cpu_s", "wall_s")
        }
        successes = [run["success_rate"] for run in at_mark]
        summaries.append(
            {
                "mark": at_mark[0]["mark"],
                **{key: round(value, 1) for key, value in means.items()},
                "return_mean": round(sum(returns) / len(returns), 2),
                "return_interval": [round(interval.low, 2), round(interval.high, 2)],
                "return_range": [min(returns), max(returns)],
                "success_mean": None
                if None in successes
                else round(sum(successes) / len(successes), 3),
                "success_least": None if None in successes else min(successes),
            }
        )
    return summaries


def draw(path: Path, environments: dict[str, Any]) -> None:
    """Plot the curves of all agents with their intervals: a row per environment, over steps, CPU
    time and wall time."""
    from bricksrl.plotting import new_figure, save

    figure = new_figure(13, 4.2 * len(environments))
    rows = figure.subplots(len(environments), 3, sharey="row", squeeze=False)
    for (env, agents), row in zip(environments.items(), rows, strict=True):
        for axes, key, label in zip(
            row,
            ("steps", "cpu_s", "wall_s"),
            ("robot steps", "CPU time / s", "wall time / s"),
            strict=True,
        ):
            for agent, result in agents.items():
                points = result["summary"]
                x = [point[key] for point in points]
                (line,) = axes.plot(
                    x, [point["return_mean"] for point in points], "o-", markersize=3, label=agent
                )
                low, high = zip(*(point["return_interval"] for point in points), strict=True)
                axes.fill_between(x, low, high, color=line.get_color(), alpha=0.2, linewidth=0)
            axes.set_xlabel(label)
            axes.grid(alpha=0.3)
        row[0].set_ylabel(f"{env}: return")
        row[0].legend(loc="lower right")
    save(figure, path, 110)


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument(
        "--envs", nargs="+", default=["WalkerSim-v0", "RoboArmSim-v0"], choices=list(MARKS)
    )
    parser.add_argument("--agents", nargs="+", default=["sac"], choices=AGENTS)
    parser.add_argument(
        "--episodes",
        type=int,
        default=25,
        help=f"as many times {LENGTH} steps, those of the start included",
    )
    args = session.parse(preset="default", seeds=10)
    end = args.episodes * LENGTH
    cells: dict[str, tuple[Any, ...]] = {
        f"{env}-{agent}-{args.preset}-{end}": (env, agent, args.preset, marks, "steps", {})
        for env in args.envs
        for marks in ([*(mark for mark in MARKS[env] if mark < end), end],)
        for agent in args.agents
    }
    variant = "" if args.preset == "default" else f"_{args.preset}"
    known: dict[str, Any] = session.known(variant).get("environments", {})
    for (env, agent, *_), runs in zip(
        cells.values(), session.by_seed(run, cells, args.seeds).values(), strict=True
    ):
        known.setdefault(env, {})[agent] = {"seeds": runs, "summary": summary(runs)}
    session.write(
        {
            "setup": {"preset": args.preset, "evaluated_episodes": EVALUATED_EPISODES},
            "environments": known,
        },
        variant,
    )
    draw(session.path(variant).with_suffix(".png"), known)
