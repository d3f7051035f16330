"""Trust in runs and policies whose config names code: what was made elsewhere is not executed before its owner says so.

A config may name files: a task, an algorithm, a network. Whoever uses the run executes them. This computer therefore keeps, in
the user's folder for settings, the digests of the configs that were written here, or were declared trusted.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from bricksrl.envs.user_files import is_reference
from bricksrl.errors import RunError
from bricksrl.files import write_durably
from bricksrl.hub.diagnostics.calibration import calibration_folder


def code_in(config: Any) -> tuple[str, ...]:
    """Places in Python files or modules that the plain values of a config name; using the config executes them."""
    if not isinstance(config, dict):
        return ()
    settings = config.get("settings")
    network = settings.get("network", "") if isinstance(settings, dict) else ""
    named = (config.get("env"), config.get("agent"), network)
    return tuple(name for name in named if isinstance(name, str) and is_reference(name))


def remember(data: bytes) -> None:
    """Keep the digest of a config file that was written here; where nothing can be kept, the owner is asked later."""
    with contextlib.suppress(OSError):
        _keep(data)


def require_trusted(path: Path, data: bytes, config: Any) -> None:
    """Nothing happens for a config that names no code, was written here, or was declared trusted.

    Args:
        path: the config's file; ``data`` are its bytes, and ``config`` is the config in it.

    Raises:
        RunError: it names code, and was made elsewhere or changed.
    """
    code = code_in(config)
    if code and not _digest_path(data).exists():
        raise RunError(
            f"{path} would run code ({', '.join(code)}) and was made elsewhere or changed; "
            f"read that code, then allow it with `bricksrl trust {path.parent}`"
        )


def trust(folder: Path) -> tuple[str, ...]:
    """Declare the config of a run, or of a shared policy, trusted as it is now; returns the code that it names.

    Raises:
        RunError: there is no run and no policy, or the digest cannot be kept.
    """
    for name in ("config.json", "policy.json"):
        path = folder / name
        if path.is_file():
            data = path.read_bytes()
            try:
                found = json.loads(data)
            except (ValueError, RecursionError):
                raise RunError(f"{path} is no JSON; restore the file") from None
            try:
                _keep(data)
            except OSError as error:
                raise RunError(f"cannot write to {_folder()} ({error.strerror}); make it writable") from None
            return code_in(found.get("config")) if isinstance(found, dict) else ()
    raise RunError(f"there is no run in {folder}; choose a folder with a config.json")


def _keep(data: bytes) -> None:
    path = _digest_path(data)
    if not path.exists():
        write_durably(path, b"")


def _digest_path(data: bytes) -> Path:
    return _folder() / hashlib.sha256(data).hexdigest()


def _folder() -> Path:
    return calibration_folder().parent / "trusted"
