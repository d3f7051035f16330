"""Training with several seeds in parallel, and the summary of their results.

A run is a function of its configuration, `train_and_evaluate`, called in a single-threaded process
of this computer, with as many at a time as there are cores, or as a task of a Ray cluster.
`benchmarks/seeds.py` compares this with one program that trains all seeds as stacked networks.

On a Ray cluster (the extra ``distributed``), a run writes its folder on the worker's computer and
after each episode sends the changed files to an actor on this computer, which mirrors the folder.
Where a worker is lost, Ray restarts the run elsewhere: it gets its folder back from the actor and
resumes.
"""

import contextlib
import os
import platform
import tempfile
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from brickhub.files import LOCK, TEMPORARY_PREFIX, write_durably, writing
from brickhub.seed import check_seed
from brickhub.user_files import failure_of_user
from bricksrl.child_process import END, ChildProcess, Message, leave, parent_channel
from bricksrl.errors import BricksError, RunError, installed, message_of
from bricksrl.evaluation.comparison import Group, compare, draw
from bricksrl.training import RunFolder, TrainConfig
from bricksrl.training.callbacks import Callback, Episode, Progress

MAX_SEEDS = 1000
"""Maximum number of seeds of one command."""
RETRIES = 3
"""Workers that a function on the cluster may lose, each of which is replaced."""
# Ray would otherwise take a third of the memory, and the messages of runs are small.
_STORE_BYTES = 100_000_000
# A run is one process with one thread, because more threads than cores would wait for one another.
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
_END_TIMEOUT_S = 60.0
_STOP_TIMEOUT_S = 10.0
_POLL_S = 0.5

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
    """Train ``count`` seeds, starting with ``config.seed``, each in its folder within
    ``config.run_dir``, and compare them.

    Args:
        jobs: concurrent processes; by default the number of cores.
        on: "ray", or "ray:ADDRESS" for a cluster; by default local processes. The results are the
            same.

    Raises:
        RunError: the folder exists, the robot is real, or a seed failed; the other seeds are still
            trained.
        DescriptionError: the last seed is invalid.
    """
    check_count(count)
    if config.hub != "virtual":
        raise RunError(
            "there is one robot and several seeds want it at once; train them one after the "
            "other with --seed"
        )
    check_seed(config.seed + count - 1)
    folder = config.run_dir
    address = None if on is None else parse_on(on)
    if folder is None or folder.exists():
        raise RunError(f"{folder} exists already; choose another folder")
    seeds = range(config.seed, config.seed + count)
    folders = {seed: folder / f"seed-{seed}" for seed in seeds}
    configs = [replace(config, seed=seed, run_dir=run_dir) for seed, run_dir in folders.items()]
    try:
        with writing(folder):
            folder.mkdir(parents=True)
        train_all = _train_in_processes if on is None else partial(train_on_cluster, address)
        results = train_all(configs, jobs, on_line)
    except BaseException:
        # An empty folder would be in the way of the next try. This fails if anything was written,
        # which then stays.
        with contextlib.suppress(OSError):
            folder.rmdir()
        raise
    outcomes = zip(seeds, results, strict=True)
    errors = [(seed, error) for seed, error in outcomes if error is not None]
    if errors:
        with contextlib.suppress(OSError):
            folder.rmdir()
        seed, error = errors[0]
        raise RunError(f"{len(errors)} of {count} seeds failed; seed {seed}: {error}")
    comparison = compare(list(folders.values()))
    write_durably(folder / "summary.json", (comparison.to_json() + "\n").encode())
    draw(folder / "learning_curves.png", comparison.groups)
    return comparison.groups[0]


class Reporter(Callback):
    """Callback that sends a message per episode."""

    def __init__(self, send: Callable[[dict[str, Any]], None]) -> None:
        self.send = send

    def on_episode(
        self,
        episode: Episode,
        progress: Progress,
    ) -> None:
        self.send({"episode": episode.episode, "return": episode.return_})


def train_and_evaluate(
    config: dict[str, Any],
    run_dir: Path,
    reporter: Reporter,
    stop: threading.Event | None = None,
) -> str | None:
    """Train into a folder, or resume the run in it, evaluate, and report; returns the error, if
    any, also one of the user's code. Raises KeyboardInterrupt if ``stop`` is set meanwhile."""
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.training.run import resume, train

    try:
        # On a cluster, a run that lost its worker begins here again, with what it had saved.
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


def _train_in_processes(
    configs: Sequence[TrainConfig],
    jobs: int | None,
    on_line: OnLine,
) -> list[str | None]:
    """Train all in local processes, so many at a time; returns the error of each, or ``None``."""
    waiting = deque(range(len(configs)))
    running = dict[int, ChildProcess]()
    messages: SimpleQueue[tuple[int, Message | None]] = SimpleQueue()
    errors: list[str | None] = [None] * len(configs)

    def start(number: int) -> None:
        process = ChildProcess(
            __name__,
            lambda message: messages.put((number, message)),
            OMP_NUM_THREADS="1",
            MKL_NUM_THREADS="1",
        )
        running[number] = process
        # If the process has ended, its end is reported elsewhere.
        with contextlib.suppress(OSError):
            process.send("train", (configs[number].to_dict(), configs[number].run_dir))

    try:
        while waiting or running:
            while waiting and len(running) < (jobs or os.cpu_count() or 1):
                start(waiting.popleft())
            # The wait is cut into pieces, because Windows tells of a Ctrl-C only when a wait is
            # over.
            try:
                number, message = messages.get(timeout=_POLL_S)
            except Empty:
                continue
            if message is not None:
                errors[number] = message[1].get("error", errors[number])
                on_line(configs[number].seed, message[1])
                continue
            code = running.pop(number).end(_END_TIMEOUT_S)
            # A run's own message tells more than its exit code.
            if code != 0 and not errors[number]:
                errors[number] = f"its process ended with exit code {code}"
    except BaseException:
        # All are asked first and then waited for. They end after their present steps, at the same
        # time, and what they saved is kept.
        for process in running.values():
            with contextlib.suppress(OSError):
                process.send(*END)
        for process in running.values():
            process.end(_STOP_TIMEOUT_S)
        raise
    return errors


def main() -> None:
    """Entry point of a seed's process, ``python -m bricksrl.evaluation.multi_seed``: train and
    evaluate as ordered; sends a message for each episode, one for the evaluation, and one for an
    error. Ends after the present step if the parent asks for it or is gone."""
    orders: SimpleQueue[Message] = SimpleQueue()
    stop = threading.Event()

    def receive(message: Message | None) -> None:
        # None is the end of the pipe: the parent is gone, and nobody needs the run.
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
            if (
                error := train_and_evaluate(
                    config,
                    run_dir,
                    reporter,
                    stop,
                )
            ) is not None:
                reporter.send({"error": error})
        code = 0
    except (BrokenPipeError, KeyboardInterrupt):
        # The parent is gone or has asked for the end, so there is nobody to tell.
        pass
    except Exception:  # noqa: BLE001  an exit at once would not print it
        traceback.print_exc()
    leave(code)


def parse_on(text: str) -> str | None:
    """Parse ``ray`` or ``ray:ADDRESS`` into the address of the cluster; ``None`` for a local one.
    Raises RunError if the text is neither."""
    runner, colon, address = text.partition(":")
    if runner != "ray" or (colon and not address):
        raise RunError(
            f"there is no '{text}' to run on; choose ray, or ray:ADDRESS for a cluster that "
            "is there"
        )
    return address or None


@contextlib.contextmanager
def connected(address: str | None, cpus: int | None = None) -> Iterator[Any]:
    """The ``ray`` module, connected to a cluster, or to a local one for the duration of this
    context. Raises RunError if Ray is not installed, or the cluster does not answer.

    Args:
        cpus: concurrent runs of a local cluster; by default the number of cores.
    """
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    with installed("Ray", RunError, '"bricksrl[distributed]"'):
        import ray
    if ray.is_initialized():
        raise RunError("Ray is at work in this process already; shut it down first")
    options: dict[str, Any] = {
        "log_to_driver": False,
        "runtime_env": {"env_vars": _ENVIRONMENT},
        "logging_level": "ERROR",
    }
    if address is None:
        # These options keep Ray to this computer: no dashboard, and no address that others could
        # reach.
        options |= {
            "num_cpus": cpus or os.cpu_count() or 1,
            "num_gpus": 0,
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
            "_node_ip_address": "127.0.0.1",
        }
    else:
        options["address"] = address
    try:
        ray.init(**options)
    except (ConnectionError, OSError, RuntimeError, ValueError) as error:
        cluster = "a cluster here" if address is None else f"the cluster at {address}"
        raise RunError(
            f"{cluster} does not start or answer ({message_of(error)}); see `ray status`"
        ) from None
    try:
        yield ray
    finally:
        ray.shutdown()


def map_on_cluster(
    ray: Any,
    function: Callable[..., Any],
    orders: Sequence[tuple[Any, ...]],
) -> Iterator[Any]:
    """Map a function over argument tuples in parallel, and yield the results in order; a lost
    worker is replaced."""
    remote = ray.remote(function).options(num_cpus=1, max_retries=RETRIES)
    yield from map(ray.get, [remote.remote(*order) for order in orders])


class Keeper:
    """Ray actor on the driver's computer that collects the files and the messages of the runs."""

    def __init__(self, folders: Sequence[str]) -> None:
        self._folders = [Path(folder) for folder in folders]
        self._messages: list[tuple[int, dict[str, Any]]] = []

    def keep(
        self,
        number: int,
        files: dict[str, bytes],
        message: dict[str, Any],
    ) -> None:
        """Write files into the folder of a run, in their order, and store its message."""
        for name, data in files.items():
            path = self._folders[number] / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_durably(path, data)
        self._messages.append((number, message))

    def files(self, number: int) -> dict[str, bytes]:
        """All files of a run, by path in its folder."""
        folder = self._folders[number]
        paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}

    def messages(self) -> list[tuple[int, dict[str, Any]]]:
        """Messages since the last call, each with the index of its run."""
        messages = self._messages
        self._messages = []
        return messages


def changed_files(folder: Path, known: dict[str, tuple[int, int]]) -> dict[str, bytes]:
    """Contents of the files whose time or size is not ``known``, which is updated, by path in the
    folder. The checkpoint comes last, as it depends on the others."""
    changed = {}
    checkpoint_last = lambda path: (path.name == "checkpoint.bin", path)  # noqa: E731
    for path in sorted(folder.rglob("*"), key=checkpoint_last):
        # A temporary file may vanish at any moment, and Windows lets nobody read a lock.
        if path.name.startswith((TEMPORARY_PREFIX, LOCK)) or not path.is_file():
            continue
        stat = path.stat()
        # Names get slashes, because the keeper's computer may have another system.
        name = path.relative_to(folder).as_posix()
        version = (stat.st_mtime_ns, stat.st_size)
        if known.get(name) != version:
            known[name] = version
            changed[name] = path.read_bytes()
    return changed


def train_on_worker(
    number: int,
    config: dict[str, Any],
    keeper: Any,
) -> str | None:
    """Start one run on a worker, or resume it from the keeper's files, and evaluate it; returns the
    error, if any."""
    import ray
    import torch

    torch.set_num_threads(1)

    class StartReporter(Reporter):
        def on_start(
            self,
            config: TrainConfig,
            run_dir: Path,
            episodes_done: int,
        ) -> None:
            self.send({"started": episodes_done, "pid": os.getpid(), "node": platform.node()})

    with tempfile.TemporaryDirectory(prefix="bricksrl-") as temporary:
        folder = Path(temporary) / "run"
        known = dict[str, tuple[int, int]]()

        def send(message: dict[str, Any]) -> None:
            ray.get(keeper.keep.remote(number, changed_files(folder, known), message))

        files = ray.get(keeper.files.remote(number))
        # Without a checkpoint there is nothing to go on from, so the run starts anew.
        if "checkpoint.bin" in files:
            for name, data in files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(data)
        return train_and_evaluate(config, folder, StartReporter(send))


def train_on_cluster(
    address: str | None,
    configs: Sequence[TrainConfig],
    cpus: int | None,
    on_line: OnLine,
) -> list[str | None]:
    """Train all on a cluster, each into its folder on this computer; returns the error of each, or
    ``None``. Raises RunError if the cluster cannot be reached. ``cpus``: as in `connected`."""
    with connected(address, cpus) as ray:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        # The keeper writes files of this computer, so it must not run elsewhere.
        this_node = ray.get_runtime_context().get_node_id()
        on_this_node = NodeAffinitySchedulingStrategy(node_id=this_node, soft=False)
        folders = [str(Path(config.run_dir or "").absolute()) for config in configs]
        keeper_class = ray.remote(Keeper)
        keeper_class = keeper_class.options(num_cpus=0, scheduling_strategy=on_this_node)
        keeper = keeper_class.remote(folders)
        remote = ray.remote(train_on_worker).options(num_cpus=1, max_retries=RETRIES)
        waiting = {
            remote.remote(number, config.to_dict(), keeper): number
            for number, config in enumerate(configs)
        }
        errors: list[str | None] = [None] * len(configs)
        while waiting:
            done, _ = ray.wait(list(waiting), timeout=_POLL_S)
            # Messages are read before finished runs leave the table, because some are from those.
            for number, message in ray.get(keeper.messages.remote()):
                on_line(configs[number].seed, message)
            for job in done:
                number = waiting.pop(job)
                try:
                    errors[number] = ray.get(job)
                except ray.exceptions.RayTaskError as error:
                    # This is an error of the run, such as a full disk, and its last line says
                    # which.
                    errors[number] = str(error).strip().splitlines()[-1]
                except ray.exceptions.RayError as error:
                    errors[number] = (
                        f"its worker was lost {RETRIES + 1} times ({type(error).__name__})"
                    )
        return errors


if __name__ == "__main__":
    main()
