"""Training with several seeds in parallel, and the summary of their results.

Each seed is a single-threaded process, with as many at a time as there are cores. `benchmarks/seeds.py` compares this with one
program that trains all seeds as stacked networks.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from brickhub.files import write_durably, writing
from brickhub.seed import check_seed
from bricksrl.child_process import END, ChildProcess, Message
from bricksrl.errors import RunError
from bricksrl.evaluation.cluster import parse_on, train_on_cluster
from bricksrl.evaluation.comparison import Group, compare, draw

if TYPE_CHECKING:
    from bricksrl.training.config import TrainConfig

MAX_SEEDS = 1000
"""Maximum number of seeds of one command."""
_END_TIMEOUT_S, _STOP_TIMEOUT_S = 60.0, 10.0

OnLine = Callable[[int, dict[str, Any]], None]
"""Called, from several threads, with a seed and a message: an episode and its return, or the return of the evaluation."""


def seed_folder(folder: Path, seed: int) -> Path:
    """Folder of a seed's run."""
    return folder / f"seed-{seed}"


def check_count(count: int) -> None:
    """Raise RunError unless ``count`` is an allowed number of seeds."""
    if not 2 <= count <= MAX_SEEDS:
        raise RunError(f"seeds is {count}; give 2 to {MAX_SEEDS}, or omit --seeds")


def train_seeds(
    config: TrainConfig,
    count: int,
    *,
    jobs: int | None = None,
    on: str | None = None,
    on_line: OnLine = lambda seed, message: None,
) -> Group:
    """Train ``count`` seeds, starting with ``config.seed``, each in its folder within ``config.run_dir``, and compare them.

    Args:
        jobs: concurrent processes; by default the number of cores.
        on: "ray", or "ray:ADDRESS" for a cluster; by default local processes. The results are the same.

    Raises:
        RunError: the folder exists, the robot is real, or a seed failed; the other seeds are still trained.
        DescriptionError: the last seed is invalid.
    """
    check_count(count)
    if config.hub != "virtual":
        raise RunError("there is one robot and several seeds want it at once; train them one after the other with --seed")
    check_seed(config.seed + count - 1)
    folder = config.run_dir
    address = None if on is None else parse_on(on)
    if folder is None or folder.exists():
        raise RunError(f"{folder} exists already; choose another folder")
    seeds = tuple(range(config.seed, config.seed + count))
    configs = [replace(config, seed=seed, run_dir=seed_folder(folder, seed)) for seed in seeds]
    try:
        with writing(folder):
            folder.mkdir(parents=True)
        if on is None:
            results = _in_processes(configs, jobs, on_line)
        else:
            orders = [(run.to_dict(), seed_folder(folder, run.seed)) for run in configs]
            results = train_on_cluster(address, orders, lambda index, message: on_line(seeds[index], message), cpus=jobs)
    except BaseException:
        with contextlib.suppress(OSError):
            folder.rmdir()  # fails if anything was written
        raise
    errors = [(seed, error) for seed, error in zip(seeds, results, strict=True) if error is not None]
    if errors:
        with contextlib.suppress(OSError):
            folder.rmdir()
        seed, error = errors[0]
        raise RunError(f"{len(errors)} of {count} seeds failed; seed {seed}: {error}")
    comparison = compare([seed_folder(folder, seed) for seed in seeds])
    write_durably(folder / "summary.json", (comparison.to_json() + "\n").encode())
    draw(folder / "learning_curves.png", comparison.groups)
    return comparison.groups[0]


def _in_processes(configs: Sequence[TrainConfig], jobs: int | None, on_line: OnLine) -> list[str | None]:
    """Train all in local processes; returns the error of each, or ``None``."""
    processes = _Processes()

    def run(config: TrainConfig) -> str | None:
        return processes.run(config, lambda message: on_line(config.seed, message))

    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        try:
            return list(pool.map(run, configs))
        except BaseException:
            processes.end()
            pool.shutdown(cancel_futures=True)
            raise


class _Processes:
    """Set of running worker processes, which can be terminated together."""

    def __init__(self) -> None:
        self._running: set[ChildProcess] = set()
        self._lock = threading.Lock()
        self._ended = False

    def run(self, config: TrainConfig, on_message: Callable[[dict[str, Any]], None]) -> str | None:
        """Train one seed; returns the error, if any."""
        messages: SimpleQueue[Message | None] = SimpleQueue()
        with self._lock:
            if self._ended:
                return "stopped"
            process = ChildProcess(
                "bricksrl.evaluation.multi_seed_worker", messages.put, OMP_NUM_THREADS="1", MKL_NUM_THREADS="1"
            )
            self._running.add(process)
        with contextlib.suppress(OSError):  # its end is reported
            process.send("train", (config.to_dict(), config.run_dir))
        error = None
        for _, message in iter(messages.get, None):
            error = message.get("error", error)
            on_message(message)
        with self._lock:
            self._running.discard(process)
        code = process.end(_END_TIMEOUT_S)
        return error or (None if code == 0 else f"its process ended with exit code {code}")

    def end(self) -> None:
        """End all processes after their present steps and start no more; saved files are kept."""
        with self._lock:
            self._ended = True
            running = list(self._running)
        for process in running:
            with contextlib.suppress(OSError):
                process.send(*END)
        for process in running:
            process.end(_STOP_TIMEOUT_S)
