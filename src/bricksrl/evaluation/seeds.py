"""The same training with several seeds, side by side, and what they say together.

Each seed is a process of its own on one thread, as many at a time as there are cores. `benchmarks/seeds.py` measures this against
one program that trains all of them as stacked networks.
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bricksrl.data.files import write_durably
from bricksrl.errors import RunError
from bricksrl.evaluation.statistics import Interval, interquartile_mean, stratified_bootstrap_interval
from bricksrl.seed import check_seed
from bricksrl.training.run import RunFolder

if TYPE_CHECKING:
    from bricksrl.training.config import TrainConfig

EVALUATED_EPISODES = 5

OnLine = Callable[[int, dict[str, Any]], None]
"""Told, from several threads, a seed and what its process said: an episode and its return, or the return of its evaluation."""


@dataclass(frozen=True)
class SeedsSummary:
    """Several seeds of one training.

    Attributes:
        returns: mean return of the evaluation of each seed.
        return_iqm, return_interval: interquartile mean of these, and its 95 % bootstrap interval.
        curve: for each episode of training the interquartile mean over the seeds, and the ends of its interval.
    """

    env: str
    agent: str
    seeds: tuple[int, ...]
    returns: tuple[float, ...]
    return_iqm: float
    return_interval: Interval
    curve: tuple[tuple[float, float, float], ...]

    def to_json(self) -> str:
        """One JSON object."""
        return json.dumps(dataclasses.asdict(self), indent=2)


def seed_folder(folder: Path, seed: int) -> Path:
    """Where a seed's run is."""
    return folder / f"seed-{seed}"


def train_seeds(
    config: TrainConfig, count: int, *, jobs: int | None = None, on_line: OnLine = lambda seed, message: None
) -> SeedsSummary:
    """Train with ``count`` seeds from ``config.seed`` on, each into a folder of its own within ``config.run_dir``; then sum up.

    Args:
        jobs: processes at a time; without it as many as there are cores.

    Raises:
        RunError: the folder exists, the robot is a real one, or a seed failed; the others are then trained all the same.
        DescriptionError: the last seed cannot be one.
    """
    if count < 2:
        raise RunError(f"seeds is {count}; give 2 or more, or leave --seeds away")
    if config.hub != "virtual":
        raise RunError("there is one robot and several seeds want it at once; train them one after the other with --seed")
    check_seed(config.seed + count - 1)
    folder = config.run_dir
    if folder is None or folder.exists():
        raise RunError(f"{folder} exists already; choose another folder")
    folder.mkdir(parents=True)
    seeds = tuple(range(config.seed, config.seed + count))
    processes = _Processes()

    def run(seed: int) -> str | None:
        return processes.run(
            replace(config, seed=seed, run_dir=seed_folder(folder, seed)), lambda message: on_line(seed, message)
        )

    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        try:
            errors = [(seed, error) for seed, error in zip(seeds, pool.map(run, seeds), strict=True) if error is not None]
        except BaseException:
            processes.end()
            raise
    if errors:
        seed, error = errors[0]
        raise RunError(f"{len(errors)} of {count} seeds failed; seed {seed}: {error}")
    summary = summarise([seed_folder(folder, seed) for seed in seeds])
    write_durably(folder / "summary.json", (summary.to_json() + "\n").encode())
    draw(folder / "learning_curves.png", summary)
    return summary


class _Processes:
    """Those that are running, so that they can be ended together."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._over = False

    def run(self, config: TrainConfig, on_message: Callable[[dict[str, Any]], None]) -> str | None:
        """Train one seed; returns what went wrong."""
        order = {"config": config.to_dict(), "run_dir": str(config.run_dir), "evaluated_episodes": EVALUATED_EPISODES}
        command = [sys.executable, "-m", "bricksrl.evaluation.seed_process"]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        with self._lock:
            if self._over:
                return "stopped"
            process = subprocess.Popen(  # noqa: S603  our own interpreter
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
            )
            self._running.add(process)
        error = None
        with process:
            assert process.stdin is not None and process.stdout is not None  # noqa: S101  both are pipes
            process.stdin.write(json.dumps(order) + "\n")
            process.stdin.close()
            for line in process.stdout:
                message = json.loads(line)
                error = message.get("error", error)
                on_message(message)
        with self._lock:
            self._running.discard(process)
        return error or (None if process.returncode == 0 else f"its process ended with exit code {process.returncode}")

    def end(self) -> None:
        """End them all, and start no more; what was saved stays."""
        with self._lock:
            self._over = True
            for process in self._running:
                process.terminate()


def summarise(run_dirs: Sequence[Path]) -> SeedsSummary:
    """What runs say together that differ in nothing but their seed, each with an evaluation.

    Raises:
        RunError: a folder holds no run, or no evaluation.
    """
    configs = [RunFolder(path).read_config() for path in run_dirs]
    curves = [[episode.return_ for episode in RunFolder(path).read_episodes()] for path in run_dirs]
    returns = tuple(_evaluated(RunFolder(path)) for path in run_dirs)
    points = []
    for scores in zip(*curves, strict=False):
        interval = stratified_bootstrap_interval([scores])
        points.append((float(interquartile_mean(np.array(scores))), interval.low, interval.high))
    return SeedsSummary(
        env=configs[0].env,
        agent=configs[0].agent,
        seeds=tuple(config.seed for config in configs),
        returns=returns,
        return_iqm=float(interquartile_mean(np.array(returns))),
        return_interval=stratified_bootstrap_interval([returns]),
        curve=tuple(points),
    )


def _evaluated(folder: RunFolder) -> float:
    try:
        return float(json.loads(folder.evaluation_path.read_bytes())["return_mean"])
    except (OSError, ValueError, KeyError, TypeError):
        raise RunError(f"{folder.path} has no evaluation; run `bricksrl evaluate {folder.path}` first") from None


def draw(path: Path, summary: SeedsSummary) -> None:
    """Draw the interquartile mean over episodes, with its interval, into a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    episodes = range(1, len(summary.curve) + 1)
    means, lows, highs = zip(*summary.curve, strict=True)
    axes.fill_between(episodes, lows, highs, color="#9fb8dc", alpha=0.5, linewidth=0, label="95 % interval")
    axes.plot(episodes, means, color="#0b5cad", linewidth=2, label="interquartile mean")
    axes.set_title(f"{summary.env} · {summary.agent} · {len(summary.seeds)} seeds", loc="left", fontweight="bold")
    axes.set_xlabel("episode")
    axes.set_ylabel("return (sum of rewards)")
    axes.grid(axis="y", color="#e5e7eb")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=150)
    write_durably(path, png.getvalue())
