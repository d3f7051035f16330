"""Trust in files that name code: code from elsewhere is executed only after the user allowed it.

The config of a run or of a shared policy, and a file of settings, may name the user's code: a task,
an algorithm, a transform, a network. Using it executes that code. The digests of such files that
were written on this computer, or declared trusted, are therefore kept in the user's settings
folder, or, where that cannot be written, as at many schools, in a folder of the user's among the
temporary files. What counts as code is said by `bricksrl.training.config.code_in`.
"""

import contextlib
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from brickhub.files import folder_with, quoted, reading, write_durably
from brickhub.hub.diagnostics.calibration import calibration_folder
from bricksrl.errors import RunError, UntrustedError
from bricksrl.training.config import code_in, code_in_settings
from bricksrl.training.existing_run import CONFIG, POLICY

_CONFIGS = CONFIG, POLICY


def remember(data: bytes) -> None:
    """Keep the digest of a config file written here; if it cannot be written, the user has to
    declare trust later."""
    with contextlib.suppress(OSError):
        _keep(data)


def require_trusted(path: Path, data: bytes, code: Sequence[str]) -> None:
    """Require that a file names no code, was written here, or was declared trusted. Raises
    UntrustedError if it names code, and was made elsewhere or changed.

    Args:
        path: the file; ``data`` are its bytes.
        code: the texts in it that may name code.
    """
    if code and not is_trusted(data):
        trusted = path.parent if path.name in _CONFIGS else path
        raise UntrustedError(
            f"{path} would run code ({', '.join(map(_shown, code))}) and was made elsewhere or "
            "changed; "
            f"read that code, then allow it with `bricksrl trust {quoted(trusted)}`"
        )


def is_trusted(data: bytes) -> bool:
    """Whether a file of this content was written here, or declared trusted."""
    return any((folder / _digest(data)).exists() for folder in _folders())


def trust(path: Path) -> tuple[str, ...]:
    """Declare the present config of a run or a shared policy, or a file of settings, trusted;
    returns the texts in it that may name code. Raises RunError if there is none, or the digest
    cannot be written.

    Args:
        path: folder of the run or the policy, or the file.
    """
    file = (
        path
        if path.is_file()
        else next((path / name for name in _CONFIGS if (path / name).is_file()), None)
    )
    if file is None:
        raise RunError(f"there is no run in {path}; choose {folder_with(path, *_CONFIGS)}")
    with reading("the config", file, RunError, "restore the file"):
        data = file.read_bytes()
        content = dict(json.loads(data))
        is_config = file.name in _CONFIGS
        code = (
            code_in(content.get("config"))
            if is_config
            else code_in_settings(dict(content.get("settings", content)))
        )
    try:
        _keep(data)
    except OSError as error:
        raise RunError(
            f"cannot write to {_folders()[0]} ({error.strerror}); make it writable"
        ) from None
    return code


def _shown(name: str) -> str:
    """A name in one line."""
    return name if name.isprintable() and name == name.strip() else repr(name)


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
