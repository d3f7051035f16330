"""Training with several seeds in parallel, and the summary of their results.

A run is a function of its configuration, `train_and_evaluate`, called in a single-threaded process of this computer, with as many
at a time as there are cores, or as a task of a Ray cluster. `benchmarks/seeds.py` compares this with one program that trains all
seeds as stacked networks.
"""

from __future__ import annotations

import contextlib
import os
import threading
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from brickhub.files import write_durably, writing
from brickhub.seed import check_seed
from bricksrl.child_process import END, ChildProcess, Message, leave, parent_channel
from bricksrl.errors import BricksError, RunError
from bricksrl.evaluation.cluster import parse_on, train_on_cluster
from bricksrl.evaluation.comparison import Group, compare, draw
from bricksrl.training.callbacks import Callback, Episode, Progress

if TYPE_CHECKING:
    from bricksrl.training.config import TrainConfig

MAX_SEEDS = 1000
"""Maximum number of seeds of one command."""
_END_TIMEOUT_S, _STOP_TIMEOUT_S = 60.0, 10.0

OnLine = Callable[[int, dict[str, Any]], None]
"""Called with a seed and a message: an episode and its return, or the return of the evaluation."""


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
    folders = {seed: folder / f"seed-{seed}" for seed in range(config.seed, config.seed + count)}
    configs = [replace(config, seed=seed, run_dir=run_dir) for seed, run_dir in folders.items()]
    try:
        with writing(folder):
            folder.mkdir(parents=True)
        train = _train_in_processes if on is None else partial(train_on_cluster, address)
        results = train(configs, jobs, on_line)
    except BaseException:
        with contextlib.suppress(OSError):
            folder.rmdir()  # fails if anything was written
        raise
    errors = [(seed, error) for seed, error in zip(folders, results, strict=True) if error is not None]
    if errors:
        with contextlib.suppress(OSError):
            folder.rmdir()
        seed, error = errors[0]
        raise RunError(f"{len(errors)} of {count} seeds failed; seed {seed}: {error}")
    comparison = compare(list(folders.values()))
    write_durably(folder / "summary.json", (comparison.to_json() + "\n").encode())
    draw(folder / "learning_curves.png", comparison.groups)
    return comparison.groups[0]


def _train_in_processes(configs: Sequence[TrainConfig], jobs: int | None, on_line: OnLine) -> list[str | None]:
    """Train all in local processes, so many at a time; returns the error of each, or ``None``."""
    waiting, running = deque(range(len(configs))), dict[int, ChildProcess]()
    messages: SimpleQueue[tuple[int, Message | None]] = SimpleQueue()
    errors: list[str | None] = [None] * len(configs)

    def start(number: int) -> None:
        process = ChildProcess(
            __name__, lambda message: messages.put((number, message)), OMP_NUM_THREADS="1", MKL_NUM_THREADS="1"
        )
        running[number] = process
        with contextlib.suppress(OSError):  # its end is reported
            process.send("train", (configs[number].to_dict(), configs[number].run_dir))

    try:
        while waiting or running:
            while waiting and len(running) < (jobs or os.cpu_count() or 1):
                start(waiting.popleft())
            number, message = messages.get()
            if message is not None:
                errors[number] = message[1].get("error", errors[number])
                on_line(configs[number].seed, message[1])
                continue
            code = running.pop(number).end(_END_TIMEOUT_S)
            errors[number] = errors[number] or (None if code == 0 else f"its process ended with exit code {code}")
    except BaseException:  # all end after their present steps, and what they saved is kept
        for process in running.values():
            with contextlib.suppress(OSError):
                process.send(*END)
        for process in running.values():
            process.end(_STOP_TIMEOUT_S)
        raise
    return errors


class Reporter(Callback):
    """Callback that sends a message per episode."""

    def __init__(self, send: Callable[[dict[str, Any]], None]) -> None:
        self.send = send

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self.send({"episode": episode.episode, "return": episode.return_})


def train_and_evaluate(
    config: dict[str, Any], run_dir: Path, reporter: Reporter, stop: threading.Event | None = None
) -> str | None:
    """Train into a folder, or resume the run in it, evaluate, and report; returns the error, if any, also one of the user's code.
    Raises KeyboardInterrupt if ``stop`` is set meanwhile."""
    from brickhub.user_files import failure_of_user
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.training import RunFolder, TrainConfig, resume, train

    try:
        if RunFolder(run_dir).checkpoint_path.exists():
            result = resume(run_dir, reporter, stop=stop)
        else:
            result = train(TrainConfig.from_dict(config, run_dir=run_dir), reporter, stop=stop)
        if result.interrupted:
            raise KeyboardInterrupt
        reporter.send({"evaluated": evaluate(run_dir).return_mean})
    except BricksError as error:
        return str(error)
    except Exception as error:
        message = failure_of_user(error)
        if message is None:
            raise
        return message
    return None


def main() -> None:
    """Entry point of a seed's process, ``python -m bricksrl.evaluation.multi_seed``: train and evaluate as ordered; sends a
    message for each episode, one for the evaluation, and one for an error. Ends after the present step if the parent asks for it
    or is gone."""
    orders: SimpleQueue[Message] = SimpleQueue()
    stop = threading.Event()

    def receive(message: Message | None) -> None:
        if message in (END, None):
            stop.set()
        orders.put(message or END)

    send = parent_channel(receive)
    code = 1
    try:
        _, order = orders.get()
        if order is not None:
            reporter = Reporter(partial(send, "report"))
            config, run_dir = order
            if (error := train_and_evaluate(config, run_dir, reporter, stop)) is not None:
                reporter.send({"error": error})
        code = 0
    except (BrokenPipeError, KeyboardInterrupt):  # the parent is gone, or asked for the end
        pass
    except Exception:  # noqa: BLE001  an exit at once would not print it
        traceback.print_exc()
    leave(code)


if __name__ == "__main__":
    main()
