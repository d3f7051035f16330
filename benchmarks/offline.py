"""The paper's table of offline learning, measured on the virtual robots, next to the paper's
numbers.

    python -m benchmarks offline --seeds 5

Each agent learns from each dataset with the paper's settings and number of updates, and is
evaluated on ``EVALUATED`` episodes of the virtual robot. Missing datasets are recorded first.
Earlier cells stay in the result, so that the command may be run in parts. One thread per process;
the most expensive runs come first. Means over the seeds of the mean returns, with 95 % bootstrap
intervals over seeds.
"""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks import datasets
from benchmarks.paper import OFFLINE
from benchmarks.session import Session
from bricksrl.agents import preset
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.statistics import mean, stratified_bootstrap_interval
from bricksrl.training import TrainConfig, train

EVALUATED = 10
AGENTS = ("cql", "sac", "iql", "td3bc", "td3", "bc")
KINDS = ("expert", "random")
OFFLINE_UPDATES = {
    "RunAway-v0": {"expert": 2000, "random": 2000},
    "Spinning-v0": {"expert": 5000, "random": 5000},
    "Walker-v0": {"expert": 10_000, "random": 10_000},
    "RoboArm-v0": {"expert": 5000, "random": 10_000},
}
"""Updates that the paper made from each of its datasets, by task and kind of dataset."""


def run(
    env: str, agent: str, updates: int, preset_name: str, data: str, seed: int
) -> dict[str, Any]:
    """Train one agent on one dataset, and evaluate it."""
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        settings = preset(preset_name, agent)
        config = TrainConfig(
            env,
            agent,
            episodes=1,
            seed=seed,
            settings=settings,
            data=data,
            updates=updates,
            run_dir=run_dir,
        )
        started_s = time.process_time()
        train(config)
        cpu_s = time.process_time() - started_s
        result = evaluate(run_dir, episodes=EVALUATED)
    return {"return_mean": result.return_mean, "cpu_ms_per_update": 1e3 * cpu_s / updates}


def updates_of(env: str, kind: str, share: float) -> int:
    """The paper's number of updates, or a share of it."""
    return max(1, round(share * OFFLINE_UPDATES[env][kind]))


def summary(
    env: str, kind: str, agent: str, updates: int, runs: list[dict[str, Any]]
) -> dict[str, Any]:
    """One cell of the table."""
    means = [run["return_mean"] for run in runs]
    interval = stratified_bootstrap_interval([means], mean)
    return {
        "return_mean": round(statistics.fmean(means), 2),
        "interval": [round(interval.low, 2), round(interval.high, 2)],
        "return_std": round(statistics.pstdev(means), 2),
        "paper": OFFLINE[env, kind].get(agent),
        "seeds": [round(value, 2) for value in means],
        "updates": updates,
        "cpu_ms_per_update": round(statistics.median(run["cpu_ms_per_update"] for run in runs), 2),
    }


def main(session: Session) -> None:
    """Run all jobs and write the table."""
    parser = session.parser
    parser.add_argument(
        "--data",
        type=Path,
        help=f"folder with the datasets <env>-<kind> (default: {datasets.FOLDER})",
    )
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--agents", nargs="+", default=AGENTS, choices=AGENTS)
    parser.add_argument(
        "--share", type=float, default=1.0, help="share of the updates, for a quick look"
    )
    args = session.parse(envs=list(OFFLINE_UPDATES), preset="paper", seeds=5)
    data = (args.data or session.place_of(datasets.FOLDER)).absolute()
    missing = [
        env
        for env in args.envs
        if not all((data / f"{env}-{kind}").exists() for kind in args.kinds)
    ]
    datasets.made(data, missing, quick=session.is_quick, processes=session.jobs)
    cells = list(itertools.product(args.agents, args.envs, args.kinds))
    parts = {}
    for agent, env, kind in cells:
        updates = updates_of(env, kind, args.share)
        parts[f"{args.preset}-{env}-{kind}-{agent}-{updates}"] = (
            env,
            agent,
            updates,
            args.preset,
            str(data / f"{env}-{kind}"),
        )
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for (agent, env, kind), of_cell in zip(
        cells, session.by_seed(run, parts, args.seeds).values(), strict=True
    ):
        found[env, kind, agent] = summary(
            env, kind, agent, updates_of(env, kind, args.share), of_cell
        )
    variant = "" if args.preset == "paper" else f"_{args.preset}"
    known: dict[str, dict[str, dict[str, Any]]] = session.known(variant).get("datasets", {})
    order = list(OFFLINE_UPDATES)
    for env, kind, agent in sorted(found, key=lambda cell: (order.index(cell[0]), *cell[1:])):
        known.setdefault(f"{env} {kind}", {})[agent] = found[env, kind, agent]
    setup = {"preset": args.preset, "share": args.share, "evaluated_episodes": EVALUATED}
    session.write({**setup, "datasets": known}, variant)
