"""Training of several seeds on a Ray cluster, or with Ray on this computer's cores (the extra ``distributed``).

Each run is a Ray task. It writes its folder on the worker's computer and after each episode sends the changed files to an actor
on this computer, which mirrors the folder. Where a worker is lost, Ray restarts the run elsewhere: it gets its folder back from
the actor and resumes.
"""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brickhub.files import TEMPORARY_PREFIX, write_durably
from bricksrl.errors import RunError, message_of

if TYPE_CHECKING:
    from bricksrl.training.config import TrainConfig

_POLL_S = 0.5
_RETRIES = 3
_STORE_BYTES = 100_000_000
_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}


def parse_on(text: str) -> str | None:
    """Parse ``ray`` or ``ray:ADDRESS`` into the address of the cluster; ``None`` for a local one. Raises RunError if the text is
    neither."""
    runner, colon, address = text.partition(":")
    if runner != "ray" or (colon and not address):
        raise RunError(f"there is no '{text}' to run on; choose ray, or ray:ADDRESS for a cluster that is there")
    return address or None


@contextmanager
def connected(address: str | None, cpus: int | None = None) -> Iterator[Any]:
    """The ``ray`` module, connected to a cluster, or to a local one for the duration of this context. Raises RunError if Ray is
    not installed, or the cluster does not answer.

    Args:
        cpus: concurrent runs of a local cluster; by default the number of cores.
    """
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError:
        raise RunError("Ray is not installed; run `pip install 'bricksrl[distributed]'`") from None
    if ray.is_initialized():
        raise RunError("Ray is at work in this process already; shut it down first")
    options: dict[str, Any] = {"log_to_driver": False, "runtime_env": {"env_vars": _ENVIRONMENT}, "logging_level": "ERROR"}
    if address is None:
        options |= {"num_cpus": cpus or os.cpu_count() or 1, "num_gpus": 0, "include_dashboard": False}
        options |= {"object_store_memory": _STORE_BYTES, "_node_ip_address": "127.0.0.1"}
    else:
        options["address"] = address
    try:
        ray.init(**options)
    except (ConnectionError, OSError, RuntimeError, ValueError) as error:
        cluster = "a cluster here" if address is None else f"the cluster at {address}"
        raise RunError(f"{cluster} does not start or answer ({message_of(error)}); see `ray status`") from None
    try:
        yield ray
    finally:
        ray.shutdown()


class Keeper:
    """Ray actor on the driver's computer that collects the files and the messages of the runs."""

    def __init__(self, folders: Sequence[str]) -> None:
        self._folders = [Path(folder) for folder in folders]
        self._messages: list[tuple[int, dict[str, Any]]] = []

    def keep(self, number: int, files: dict[str, bytes], message: dict[str, Any]) -> None:
        """Write files into the folder of a run, in their order, and store its message."""
        for name, data in files.items():
            path = self._folders[number] / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_durably(path, data)
        self._messages.append((number, message))

    def files(self, number: int) -> dict[str, bytes]:
        """All files of a run, by path in its folder."""
        folder = self._folders[number]
        return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}

    def messages(self) -> list[tuple[int, dict[str, Any]]]:
        """Messages since the last call, each with the index of its run."""
        messages, self._messages = self._messages, []
        return messages


def changed_files(folder: Path, known: dict[str, tuple[int, int]]) -> dict[str, bytes]:
    """Contents of the files whose time or size is not ``known``, which is updated, by path in the folder. The checkpoint comes
    last, as it depends on the others."""
    changed = {}
    for path in sorted(folder.rglob("*"), key=lambda path: (path.name == "checkpoint.bin", path)):
        if path.name.startswith(TEMPORARY_PREFIX) or not path.is_file():  # such a file may vanish at any moment
            continue
        stat = path.stat()
        name, version = str(path.relative_to(folder)), (stat.st_mtime_ns, stat.st_size)
        if known.get(name) != version:
            known[name], changed[name] = version, path.read_bytes()
    return changed


def train_on_worker(number: int, config: dict[str, Any], keeper: Any) -> str | None:
    """Start one run on a worker, or resume it from the keeper's files, and evaluate it; returns the error, if any."""
    import ray
    import torch

    from bricksrl.evaluation.multi_seed import Reporter, train_and_evaluate

    torch.set_num_threads(1)

    class StartReporter(Reporter):
        def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
            self.send({"started": episodes_done, "pid": os.getpid(), "node": platform.node()})

    with tempfile.TemporaryDirectory(prefix="bricksrl-") as temporary:
        folder, known = Path(temporary) / "run", dict[str, tuple[int, int]]()

        def send(message: dict[str, Any]) -> None:
            ray.get(keeper.keep.remote(number, changed_files(folder, known), message))

        files = ray.get(keeper.files.remote(number))
        for name, data in files.items() if "checkpoint.bin" in files else ():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        return train_and_evaluate(config, folder, StartReporter(send))


def train_on_cluster(
    address: str | None, configs: Sequence[TrainConfig], cpus: int | None, on_line: Callable[[int, dict[str, Any]], None]
) -> list[str | None]:
    """Train all configs, each into its folder on this computer; returns the error of each, or ``None``. Raises RunError if the
    cluster cannot be reached.

    Args:
        cpus: as in `connected`.
        on_line: called with a seed and a message of its run.
    """
    with connected(address, cpus) as ray:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        on_this_node = NodeAffinitySchedulingStrategy(node_id=ray.get_runtime_context().get_node_id(), soft=False)
        folders = [str(Path(config.run_dir or "").absolute()) for config in configs]
        keeper = ray.remote(Keeper).options(num_cpus=0, scheduling_strategy=on_this_node).remote(folders)
        remote = ray.remote(train_on_worker).options(num_cpus=1, max_retries=_RETRIES)
        waiting = {remote.remote(number, config.to_dict(), keeper): number for number, config in enumerate(configs)}
        errors: list[str | None] = [None] * len(configs)
        while waiting:
            done, _ = ray.wait(list(waiting), timeout=_POLL_S)
            for number, message in ray.get(keeper.messages.remote()):  # of runs that are done too
                on_line(configs[number].seed, message)
            for job in done:
                number = waiting.pop(job)
                try:
                    errors[number] = ray.get(job)
                except ray.exceptions.RayTaskError as error:  # of the run, such as of a full disk; the last line says which
                    errors[number] = str(error).strip().splitlines()[-1]
                except ray.exceptions.RayError as error:
                    errors[number] = f"its worker was lost {_RETRIES + 1} times ({type(error).__name__})"
        return errors


def map_on_cluster(ray: Any, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
    """Map a function over argument tuples in parallel, and yield the results in order; a lost worker is replaced."""
    remote = ray.remote(function).options(num_cpus=1, max_retries=_RETRIES)
    yield from map(ray.get, [remote.remote(*order) for order in orders])
