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
import stat
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from brickhub.files import folder_with, quoted, reading, write_durably
from brickhub.hub.diagnostics.calibration import calibration_folder
from bricksrl.errors import RunError, UntrustedError
from bricksrl.training.config import code_in, code_in_settings
from bricksrl.training.existing_run import CONFIG, POLICY

_CONFIGS = (CONFIG, POLICY)


def remember(data: bytes) -> None:
    """Keep the digest of a config file written here; if it cannot be written, the user has to
    declare trust later."""
    with contextlib.suppress(OSError):
        _keep(data)


def require_trusted(
    path: Path,
    data: bytes,
    code: Sequence[str],
) -> None:
    """Require that a file names no code, was written here, or was declared trusted. Raises
    UntrustedError if it names code, and was made elsewhere or changed.

    Args:
        path: the file; ``data`` are its bytes.
        code: the texts in it that may name code.
    """
    if not code or is_trusted(data):
        return
    # The command takes a run or a policy by its folder.
    argument = path.parent if path.name in _CONFIGS else path
    names = ", ".join(map(_shown, code))
    raise UntrustedError(
        f"{path} would run code ({names}) and was made elsewhere or changed; "
        f"read that code, then allow it with `bricksrl trust {quoted(argument)}`"
    )


def is_trusted(data: bytes) -> bool:
    """Whether a file of this content was written here, or declared trusted."""
    digest = _digest(data)
    return any((folder / digest).exists() for folder in _folders())


def trust(path: Path) -> tuple[str, ...]:
    """Declare the present config of a run or a shared policy, or a file of settings, trusted;
    returns the texts in it that may name code. Raises RunError if there is none, or the digest
    cannot be written.

    Args:
        path: folder of the run or the policy, or the file.
    """
    file = _file_of(path)
    if file is None:
        raise RunError(f"there is no run in {path}; choose {folder_with(path, *_CONFIGS)}")
    with reading(
        "the config",
        file,
        RunError,
        "restore the file",
    ):
        data = file.read_bytes()
        content = dict(json.loads(data))
        if file.name in _CONFIGS:
            code = code_in(content.get("config"))
        else:
            # The settings that `bricksrl tune` found stand beside how it found them; otherwise they
            # are the whole file.
            code = code_in_settings(dict(content.get("settings", content)))
    # The bytes that were looked through are kept, and not the file read again, because it may
    # change in the meantime.
    try:
        _keep(data)
    except OSError as error:
        raise RunError(
            f"cannot write to {_folders()[0]} ({error.strerror}); make it writable"
        ) from None
    return code


def _file_of(path: Path) -> Path | None:
    """The file that may name code: this one, or that in a folder, if there is one."""
    if path.is_file():
        return path
    for name in _CONFIGS:
        file = path / name
        if file.is_file():
            return file
    return None


def _shown(name: str) -> str:
    """A name in one line."""
    # A stranger's text may hide its true name behind spaces and line ends.
    is_plain = name.isprintable() and name == name.strip()
    return name if is_plain else repr(name)


def _keep(data: bytes) -> None:
    """Write the digest into the first folder that can be written to. Raises OSError if none can."""
    digest = _digest(data)
    *others, last = _folders()
    for folder in others:
        with contextlib.suppress(OSError):
            _write(folder / digest)
            return
    _write(last / digest)


def _write(path: Path) -> None:
    # The file is empty, because its name says everything.
    if not path.exists():
        write_durably(path, b"")


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _folders() -> list[Path]:
    """Folders of digests that only this user can write to."""
    settings = calibration_folder().parent / "trusted"
    temporary = Path(tempfile.gettempdir()) / "bricksrl-trusted"
    # On Windows temporary files belong to the user, but elsewhere all users share their folder.
    if sys.platform == "win32":
        return [settings, temporary]
    user = os.getuid()
    private = temporary.with_name(f"bricksrl-trusted-{user}")
    with contextlib.suppress(OSError):
        private.mkdir(mode=0o700, exist_ok=True)
    # Another user may have made a folder of this name before, or a link to one, to decide what is
    # trusted here.
    if private.is_symlink() or not private.is_dir():
        return [settings]
    found = private.lstat()
    others_write = stat.S_IWGRP | stat.S_IWOTH
    if found.st_uid != user or found.st_mode & others_write:
        return [settings]
    return [settings, private]
