"""Trust in runs and policies whose config names code: code from elsewhere is executed only after the user allowed it.

A config may name files: a task, an algorithm, a network. Using the run executes them. The digests of configs that were written
on this computer, or declared trusted, are therefore kept in the user's settings folder, or, where that cannot be written, as at
many schools, in a folder of the user's among the temporary files.
"""

import contextlib
import hashlib
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from brickhub.files import folder_with, quoted, reading, write_durably
from brickhub.hub.diagnostics.calibration import calibration_folder
from brickhub.user_files import is_reference
from bricksrl.errors import RunError

_CONFIGS = "config.json", "policy.json"
CODE_SETTINGS = "network", "structure"
"""Settings of agents that may name code."""


def code_in(config: Any) -> tuple[str, ...]:
    """References to Python files or modules in a config; using the config executes them."""
    if not isinstance(config, dict):
        return ()
    settings = config["settings"] if isinstance(config.get("settings"), dict) else {}
    names = [config.get(name) for name in ("env", "agent", "transform")] + [settings.get(name) for name in CODE_SETTINGS]
    return tuple(name for name in names if isinstance(name, str) and is_reference(name))


def remember(data: bytes) -> None:
    """Keep the digest of a config file written here; if it cannot be written, the user has to declare trust later."""
    with contextlib.suppress(OSError):
        _keep(data)


def require_trusted(path: Path, data: bytes, config: Any) -> None:
    """Require that a config names no code, was written here, or was declared trusted. Raises RunError if the config names code,
    and was made elsewhere or changed.

    Args:
        path: file of the config; ``data`` are its bytes, and ``config`` is its content.
    """
    code = code_in(config)
    if code and not any((folder / _digest(data)).exists() for folder in _folders()):
        raise RunError(
            f"{path} would run code ({', '.join(code)}) and was made elsewhere or changed; "
            f"read that code, then allow it with `bricksrl trust {quoted(path.parent)}`"
        )


def trust(folder: Path) -> tuple[str, ...]:
    """Declare the present config of a run or a shared policy trusted; returns the references to code in it. Raises RunError if
    there is no run or policy in the folder, or the digest cannot be written."""
    path = next((folder / name for name in _CONFIGS if (folder / name).is_file()), None)
    if path is None:
        raise RunError(f"there is no run in {folder}; choose {folder_with(folder, *_CONFIGS)}")
    with reading("the config", path, RunError, "restore the file"):
        data = path.read_bytes()
        config = dict(json.loads(data))
    try:
        _keep(data)
    except OSError as error:
        raise RunError(f"cannot write to {_folders()[0]} ({error.strerror}); make it writable") from None
    return code_in(config.get("config"))


def _keep(data: bytes) -> None:
    *others, last = _folders()
    for folder in others:
        with contextlib.suppress(OSError):
            return _write(folder / _digest(data))
    return _write(last / _digest(data))


def _write(path: Path) -> None:
    if not path.exists():
        write_durably(path, b"")


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _folders() -> list[Path]:
    """Folders of digests that only this user can write to."""
    folders = [calibration_folder().parent / "trusted"]
    temporary = Path(tempfile.gettempdir()) / "bricksrl-trusted"
    if sys.platform != "win32":  # where temporary files are the user's own
        temporary = temporary.with_name(f"bricksrl-trusted-{os.getuid()}")
        with contextlib.suppress(OSError):
            temporary.mkdir(mode=0o700, exist_ok=True)
        state = temporary.lstat() if temporary.is_dir() and not temporary.is_symlink() else None
        if state is None or state.st_uid != os.getuid() or state.st_mode & 0o022:
            return folders
    return [*folders, temporary]
