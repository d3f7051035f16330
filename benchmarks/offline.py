"""The paper's table of offline learning, measured on the virtual robots, next to the paper's numbers.

    python benchmarks/datasets.py --out runs/datasets
    python benchmarks/offline.py --seeds 5

Each agent learns from each dataset with the paper's settings and number of updates, and is evaluated on ``EVALUATED`` episodes of
the virtual robot. Finished runs are kept in ``--work`` and not repeated, so that the command can be interrupted and resumed, or
run in parts: the table has all of them, and keeps other cells of the file. One thread per process; the most expensive runs come
first. Means over the seeds of the mean returns, with 95 % bootstrap intervals over seeds.
"""

from __future__ import annotations

import itertools
import json
import multiprocessing
import statistics
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from machine import RESULTS, command, write

from bricksrl.agents import preset
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.paper import OFFLINE
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


@dataclass(frozen=True)
class Job:
    """One agent that learns from one dataset."""

    env: str
    kind: str
    agent: str
    seed: int
    preset: str
    data: str
    updates: int

    @property
    def name(self) -> str:
        """Name of the file of its result."""
        return f"{self.preset}-{self.env}-{self.kind}-{self.agent}-{self.updates}-{self.seed}"


def run_job(job: Job) -> dict[str, Any]:
    """Train and evaluate."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        config = TrainConfig(
            job.env,
            job.agent,
            episodes=1,
            seed=job.seed,
            settings=preset(job.preset, job.agent),
            data=job.data,
            updates=job.updates,
            run_dir=run_dir,
        )
        started_s = time.process_time()
        train(config)
        cpu_s = time.process_time() - started_s
        result = evaluate(run_dir, episodes=EVALUATED)
    return {
        **asdict(job),
        "return_mean": result.return_mean,
        "returns": list(result.returns),
        "success_rate": result.success_rate,
        "cpu_ms_per_update": 1e3 * cpu_s / job.updates,
    }


def cached_result(work: Path, job: Job) -> dict[str, Any]:
    """Result of a job, from its file if it was run earlier."""
    path = work / f"{job.name}.json"
    if not path.exists():
        result = run_job(job)
        temporary = path.with_suffix(".part")
        temporary.write_text(json.dumps(result))
        temporary.rename(path)
        print(f"{job.env} {job.kind} {job.agent} seed {job.seed}: {result['return_mean']:.4g}", flush=True)
    stored: dict[str, Any] = json.loads(path.read_text())
    return stored


def updates_of(env: str, kind: str, share: float) -> int:
    """The paper's number of updates, or a share of it."""
    return max(1, round(share * OFFLINE_UPDATES[env][kind]))


def cell_of(run: dict[str, Any]) -> tuple[str, str, str]:
    """Cell of the table that a run belongs to."""
    return run["env"], run["kind"], run["agent"]


def finished(work: Path, preset: str, share: float) -> list[dict[str, Any]]:
    """All finished runs of these settings, also of earlier calls, in the order of the table."""
    runs = [json.loads(path.read_text()) for path in work.glob(f"{preset}-*.json")]
    matching = [run for run in runs if run["updates"] == updates_of(run["env"], run["kind"], share)]
    tasks = list(OFFLINE_UPDATES)
    return sorted(matching, key=lambda run: (tasks.index(run["env"]), run["kind"], run["agent"], run["seed"]))


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """One cell of the table."""
    means = [run["return_mean"] for run in runs]
    interval = stratified_bootstrap_interval([means], mean)
    paper = OFFLINE[runs[0]["env"], runs[0]["kind"]].get(runs[0]["agent"])
    return {
        "return_mean": round(statistics.fmean(means), 2),
        "interval": [round(interval.low, 2), round(interval.high, 2)],
        "return_std": round(statistics.pstdev(means), 2),
        "paper": paper,
        "seeds": [round(value, 2) for value in means],
        "updates": runs[0]["updates"],
        "cpu_ms_per_update": round(statistics.median(run["cpu_ms_per_update"] for run in runs), 2),
    }


def table(cells: dict[str, dict[str, dict[str, Any]]]) -> str:
    """The results in Markdown: mean, interval, and in brackets the paper's mean."""
    lines = ["| | " + " | ".join(cells) + " |", "|---" * (len(cells) + 1) + "|"]
    for agent in sorted({agent for agents in cells.values() for agent in agents}):
        row = []
        for agents in cells.values():
            cell = agents.get(agent)
            low, high = cell["interval"] if cell else (0.0, 0.0)
            paper = f" ({cell['paper']:.4g})" if cell and cell["paper"] is not None else ""
            row.append(f"{cell['return_mean']:.4g} [{low:.4g}, {high:.4g}]{paper}" if cell else "")
        lines.append(f"| {agent} | " + " | ".join(row) + " |")
    return "\n".join(lines)


def main() -> None:
    """Run all jobs and write the table."""
    parser = command(__doc__)
    parser.add_argument("--data", type=Path, default=Path("runs/datasets"), help="folder with the datasets <env>-<kind>")
    parser.add_argument("--work", type=Path, default=Path("runs/offline-benchmark"), help="folder for finished runs")
    parser.add_argument("--envs", nargs="+", default=list(OFFLINE_UPDATES), choices=list(OFFLINE_UPDATES))
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--agents", nargs="+", default=AGENTS, choices=AGENTS)
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--share", type=float, default=1.0, help="share of the updates, for a quick look")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    jobs = [
        Job(
            env=env,
            kind=kind,
            agent=agent,
            seed=seed,
            preset=args.preset,
            data=str((args.data / f"{env}-{kind}").absolute()),
            updates=updates_of(env, kind, args.share),
        )
        for agent, env, kind, seed in itertools.product(args.agents, args.envs, args.kinds, range(args.seeds))
    ]
    with multiprocessing.get_context("spawn").Pool(args.processes) as pool:
        pool.starmap(cached_result, [(args.work, job) for job in jobs], chunksize=1)
    name = "offline" if args.preset == "paper" else f"offline_{args.preset}"
    path = RESULTS / f"{name}.json"
    cells: dict[str, dict[str, dict[str, Any]]] = json.loads(path.read_text())["datasets"] if path.exists() else {}
    for (env, kind, agent), runs in itertools.groupby(finished(args.work, args.preset, args.share), key=cell_of):
        cells.setdefault(f"{env} {kind}", {})[agent] = summary(list(runs))
    print(table(cells))
    setup = {"preset": args.preset, "share": args.share, "evaluated_episodes": EVALUATED}
    print(write(name, {**setup, "datasets": cells}))


if __name__ == "__main__":
    main()
