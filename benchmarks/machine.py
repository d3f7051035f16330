"""The machine and the versions that a result was measured with; no name of a machine or a
person."""

from __future__ import annotations

import os
import platform
import re
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false --xla_force_host_platform_device_count=1",
    "JAX_PLATFORMS": "cpu",
    "RL_LOGGING_LEVEL": "WARNING",
    "TF_CPP_MIN_LOG_LEVEL": "3",
}
"""Environment variables for one thread in any library; to be set before torch or JAX is loaded."""
_PACKAGES = (
    "brickhub",
    "bricktwin",
    "bricksrl",
    "torch",
    "torchrl",
    "tensordict",
    "mujoco",
    "numpy",
    "greenlet",
)


def describe() -> dict[str, Any]:
    """Processor, number of cores, system and versions."""
    return {
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "system": platform.system(),
        },
        "versions": {"python": platform.python_version(), **_versions()},
    }


def _versions() -> dict[str, str]:
    """Of those packages that are installed."""
    versions = {}
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions


def _processor() -> str:
    try:
        match = re.search(
            r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text(encoding="utf-8")
        )
    except OSError:
        match = None
    return match[1] if match else platform.processor()
