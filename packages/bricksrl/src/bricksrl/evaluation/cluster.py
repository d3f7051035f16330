"""Ray cluster, or Ray on this computer's cores (the extra ``distributed``): connection, and functions on it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from bricksrl.errors import RunError, message_of

RETRIES = 3
"""Workers that a function on the cluster may lose, each of which is replaced."""
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


def map_on_cluster(ray: Any, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
    """Map a function over argument tuples in parallel, and yield the results in order; a lost worker is replaced."""
    remote = ray.remote(function).options(num_cpus=1, max_retries=RETRIES)
    yield from map(ray.get, [remote.remote(*order) for order in orders])
