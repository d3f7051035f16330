"""Parts of a benchmark, such as the trainings of its seeds: made in processes, and kept, so that
none is made twice."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any, NoReturn
from unittest import mock

import benchmarks
from benchmarks.machine import ONE_THREAD
from brickhub.files import write_durably
from bricksrl.errors import BricksError, RunError
from bricksrl.evaluation.multi_seed import map_on_cluster
from bricksrl.training.signals import StopSignals


class Failure(str):
    """The message of the error of a part, in place of its outcome."""

    __slots__ = ()


def outcomes(
    function: Callable[..., Any],
    parts: Mapping[Path, tuple[Any, ...]],
    processes: int | None = None,
    *,
    fresh: bool = False,
    resumable: bool = False,
    ray: Any = None,
) -> Iterator[Any]:
    """Outcomes of the parts, in order, each as soon as it is there; a `Failure` for a part that
    raised a `BricksError`. Raises RunError if a process was killed.

    Args:
        function: makes a part from its arguments; its outcome has to survive JSON.
        parts: arguments by the file that keeps the outcome.
        processes: concurrent processes, of one thread each; by default the number of cores. A
            single one is this process.
        fresh: make each part in a process of its own, so that its start-up counts.
        resumable: Ctrl-C may end a part in its own way, with files from which it is resumed; else
            it is at once.
        ray: the connected module, to make them on a cluster.
    """
    orders = [(function, path, arguments, resumable) for path, arguments in parts.items()]
    workers = min(processes or os.cpu_count() or 1, len(orders))
    if ray is not None:
        ray.cloudpickle.register_pickle_by_value(benchmarks)  # the workers have the package only
        yield from map_on_cluster(ray, _outcome, orders)
    elif workers <= 1 and not fresh:
        yield from (_outcome(*order) for order in orders)
    else:
        context, life = get_context("spawn"), 1 if fresh else None
        with (
            mock.patch.dict(os.environ, ONE_THREAD),
            ProcessPoolExecutor(workers, context, _start_worker, max_tasks_per_child=life) as pool,
        ):
            try:
                yield from pool.map(_worker_outcome, *zip(*orders, strict=True))
            except BrokenProcessPool:
                hint = "maybe for lack of memory; repeat the command with fewer --jobs"
                raise RunError(f"a process was killed, {hint}") from None


def kept(path: Path) -> Any:
    """The outcome in a file; ``None`` if there is none, or the file is damaged, so that the part is
    made again."""
    try:
        return dict(json.loads(path.read_bytes()))["outcome"]
    except (OSError, ValueError, TypeError, LookupError):
        return None


def _outcome(
    function: Callable[..., Any], path: Path, arguments: tuple[Any, ...], resumable: bool
) -> Any:
    """The kept outcome of a part, or else a new one."""
    if (outcome := kept(path)) is not None:
        return outcome
    try:
        with (
            nullcontext()
            if resumable
            else mock.patch.object(StopSignals, "_on_interrupt", _interrupt)
        ):
            outcome = function(*arguments)
    except BricksError as error:
        return Failure(error)
    write_durably(path, (json.dumps({"outcome": outcome}, indent=2) + "\n").encode())
    return kept(path)


def _interrupt(*_: object) -> NoReturn:
    raise KeyboardInterrupt


_interrupted = threading.Event()


def _worker_outcome(*order: Any) -> Any:
    """In a worker: as `_outcome`; after Ctrl-C it begins no other part."""
    try:
        return _interrupt() if _interrupted.is_set() else _outcome(*order)
    except KeyboardInterrupt:
        _interrupted.set()
        raise


def _start_worker() -> None:
    """End as soon as the parent process does, however it ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
