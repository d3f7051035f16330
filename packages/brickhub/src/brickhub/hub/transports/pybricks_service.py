"""Pybricks' own background service (``pybricks-service``, 2026), which keeps the link to a hub after its programs have ended."""

from __future__ import annotations

import os
import socket
import sys
import tempfile
from pathlib import Path

_PATIENCE_S = 0.2
RELEASE = "release the hub with `pb disconnect`, or end the service with `pb service stop`"


def socket_path() -> Path:
    """The service's socket (``pb_core/paths.py`` of pybricks-core 1.0)."""
    given = os.environ.get("PB_RUNTIME_DIR")
    runtime = os.environ.get("XDG_RUNTIME_DIR") if sys.platform == "linux" else None
    own = Path(runtime) / "pybricks" if runtime else Path(tempfile.gettempdir()) / f"pybricks-{os.getuid()}"
    return (Path(given) if given else own) / "pb-service.sock"


def is_running() -> bool:
    """Whether the service of this user answers; never on Windows, where it has a named pipe."""
    if not hasattr(socket, "AF_UNIX"):
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(_PATIENCE_S)
        try:
            probe.connect(str(socket_path()))
        except OSError:
            return False
    return True
