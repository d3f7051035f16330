"""Durable files: written completely or not at all, and on the disk when the call returns. Locks of
folders."""

import contextlib
import difflib
import errno
import os
import re
import secrets
import shlex
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from brickhub.errors import BricksError, DescriptionError, UnknownNameError, WriteError

TEMPORARY_PREFIX = ".part-"
"""Prefix of the names of incomplete files and folders."""
LOCK = ".lock"
"""Name of the lock of a folder's writer."""
FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
"""Numbers of errors of a full disk."""


_REPLACE_S = 2.0
"""Time in which Windows may refuse to replace what another program reads at that moment."""
_PLAIN_ON_WINDOWS = re.compile(r"[\w.:/\\+=@~-]+")
"""Words that neither PowerShell nor the command prompt takes for something else."""
_DEVICES_OF_WINDOWS = re.compile(r"(aux|con|nul|prn|(com|lpt)[1-9¹²³])\s*(\..*)?", re.IGNORECASE)
"""Names that Windows takes for devices: a file ``con.json`` cannot be made there."""


def quoted(path: Path | str) -> str:
    """A path as one word of a command line."""
    if sys.platform == "win32":
        # `list2cmdline` only quotes what has spaces, but a shell also takes `&` or `(` for
        # something else.
        word = subprocess.list2cmdline([str(path)])
        is_plain = word.startswith('"') or _PLAIN_ON_WINDOWS.fullmatch(word)
        return word if is_plain else f'"{word}"'
    return shlex.quote(str(path))


def is_device_of_windows(name: str) -> bool:
    """Whether a file or folder cannot have that name on Windows, whatever its ending."""
    return _DEVICES_OF_WINDOWS.fullmatch(name.strip()) is not None


def as_file_name(text: str) -> str:
    """A text as the name of a file or folder on every system, without an ending."""
    name = re.sub(r"[^\w-]+", "-", text)
    return f"{name}-" if is_device_of_windows(name) else name


def user_cache() -> Path:
    """Folder of what is kept between processes and can be lost. Raises RuntimeError if the user has
    no home."""
    # By the standard of these folders, an empty variable counts as one that is not set.
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "bricksrl"


def refuse_existing(path: Path, error: type[BricksError]) -> None:
    """Raise ``error`` if there is a file or folder at ``path``, which is to be written."""
    if path.exists():
        raise error(f"{path} exists already; choose another name")


def folder_with(folder: Path, *files: str) -> str:
    """``a folder with a config.json, such as runs/a or runs/b``, for a message that ``folder`` has
    none of these files. Names up to three folders that have one: the one that it is in, the newest
    of those in it, or those beside it with a similar name."""
    found: list[Path] = []
    # A folder that cannot be read, or is gone in the meantime, only costs the advice.
    with contextlib.suppress(OSError):
        found = _folders_with(folder, files)
    wanted = f"a folder with a {files[0]}"
    if not found:
        return wanted
    return f"{wanted}, such as {' or '.join(map(str, found))}"


def _folders_with(folder: Path, files: tuple[str, ...]) -> list[Path]:
    """Up to three folders around, in or beside a folder that have one of these files."""

    def has_one(path: Path) -> bool:
        return any((path / file).is_file() for file in files)

    # All three places are read before one is chosen, so that a folder that cannot be read spoils
    # the advice as a whole.
    around = [path for path in folder.parents if has_one(path)]
    inside = [path for path in folder.glob("*") if has_one(path)]
    beside = [path for path in folder.parent.glob("*") if has_one(path)]
    inside.sort(key=lambda path: path.stat().st_mtime, reverse=True)
    if around:
        return around[:1]
    if inside:
        return inside[:3]
    names = [path.name for path in beside]
    similar = difflib.get_close_matches(folder.name, names)
    return [folder.parent / name for name in similar]


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise WriteError, which says what to do, for an OSError in this context, whose subject is
    ``path``."""
    try:
        yield
    except OSError as failure:
        reason = failure.strerror or str(failure)
        # This error means that a folder was to be made where there is a file.
        if isinstance(failure, FileExistsError):
            reason = os.strerror(errno.ENOTDIR)
        remedy = "name another place"
        if failure.errno in FULL:
            remedy = f"make room on that disk, or {remedy}"
        elif isinstance(failure, PermissionError) and sys.platform == "win32":
            remedy = f"close the program that has it open, or {remedy}"
        error = WriteError(f"cannot write {path} ({reason}); {remedy}")
        error.errno = failure.errno
        error.strerror = reason
        error.filename = str(path)
        raise error from None


@contextlib.contextmanager
def reading(
    what: str,
    path: Path | str,
    error: type[BricksError],
    remedy: str,
) -> Iterator[None]:
    """Raise ``error``, with the remedy, where ``what``, the file at ``path``, cannot be read in
    this context, or its content causes any error there: one with words of ours says what is wrong
    with it."""
    try:
        yield
    except OSError as failure:
        reason = failure.strerror or str(failure)
    except (DescriptionError, UnknownNameError) as failure:
        reason = str(failure)
    # Neither is a fault of this file: a complete refusal of ours, or a file too large for this
    # computer.
    except (BricksError, MemoryError):
        raise
    # Anybody's file may have any value where another one is expected. Python's message would be
    # about its own values, and tell a user nothing.
    except Exception:  # noqa: BLE001
        if str(path).endswith(".json"):
            reason = "it is not JSON as we write it, or damaged"
        else:
            reason = "it is another file, or damaged"
    else:
        return
    raise error(f"cannot read {what} {path} ({reason}); {remedy}") from None


@contextlib.contextmanager
def parsing(refusal: BricksError) -> Iterator[None]:
    """Raise ``refusal`` where the content of a file causes any error in this context, except one of
    the refusal's own type, which is more precise."""
    try:
        yield
    except type(refusal):
        raise
    # Libraries that parse strangers' files (torch's unpickler, Arrow, safetensors) do not say which
    # errors they raise: their own, Python's, or MemoryError for a size that a file only claims.
    except Exception:  # noqa: BLE001
        raise refusal from None


def check_writable(path: Path) -> None:
    """Raise WriteError if no file can be written to ``path``. Makes neither the file nor its
    folder."""
    with writing(path):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        if path.exists():
            # Opening the file for appending needs the right to write, and changes nothing.
            path.open("ab").close()
            return
        # Missing folders are made when the file is written, so the first one that exists decides.
        folder = next(parent for parent in path.absolute().parents if parent.exists())
        # tempfile is not used, because on Windows with a Python before 3.11.9 it tries for ever.
        trial = temporary_beside(folder / "trial")
        trial.open("xb").close()
        trial.unlink()


def write_durably(path: Path, data: bytes) -> None:
    """Write ``data`` to a temporary file, sync it, rename it to ``path``, and sync the folder.

    ``path`` always has either its previous content or all of ``data``, even if the process is
    killed or the power fails. Raises WriteError if it cannot be written.
    """
    with writing(path):
        # What is no file, such as /dev/null or a pipe, takes the data, and must stay what it is.
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(data)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = temporary_beside(path)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        # Without this flag, Windows turns each line end into two bytes.
        flags |= getattr(os, "O_BINARY", 0)
        # The system reduces this mode by the user's umask; tempfile would admit the owner alone.
        handle = os.open(temporary, flags, 0o666)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                # Data goes to the disk before the renaming, because a power cut must not leave the
                # new name without data.
                os.fsync(file.fileno())
            # The file keeps its readers. Windows has no modes, but a file gets the rights of its
            # folder.
            if sys.platform != "win32" and path.is_file():
                temporary.chmod(stat.S_IMODE(path.stat().st_mode))
            put_in_place(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        # The renaming itself reaches the disk only with its folder.
        _sync_folder(path.parent)


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """A temporary folder, which is renamed to ``path`` at the end of the context, or removed after
    an exception, together with the parent folders that were made for it.

    ``path`` is always complete, even if the process is killed; a remnant then has a name that
    begins with `TEMPORARY_PREFIX`. Raises WriteError if it cannot be written.
    """
    # The innermost folder comes first, which is the order in which they can be removed again.
    made = [parent for parent in path.parents if not parent.exists()]
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = temporary_beside(path)
        folder.mkdir()
    try:
        yield folder
        with writing(path):
            put_in_place(folder, path)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        # A folder that something else uses by now cannot be removed, and stays.
        with contextlib.suppress(OSError):
            for parent in made:
                parent.rmdir()
        # The error is about a file in the temporary folder, of which a user knows nothing, so it is
        # raised anew with `path`.
        if isinstance(error, WriteError):
            with writing(path):
                raise
        raise
    _sync_folder(path.parent)


def put_in_place(complete: Path, path: Path) -> None:
    """Rename a complete file to ``path``, over a previous one, or a complete folder. Windows
    refuses while another program, such as a page or a virus scanner, has it open; that is waited
    for."""
    is_waited_for = sys.platform == "win32"
    end_s = time.monotonic() + _REPLACE_S
    while True:
        try:
            complete.replace(path)
        except PermissionError:
            # A folder is never replaced on Windows, however long one waits.
            if not is_waited_for or path.is_dir() or time.monotonic() > end_s:
                raise
            time.sleep(0.02)
        else:
            return


def temporary_beside(path: Path, suffix: str = "") -> Path:
    """A new name of an incomplete file or folder in the folder of ``path``."""
    # The new name is in the same folder, because renaming is atomic only within a file system.
    token = secrets.token_hex(8)
    return path.parent / f"{TEMPORARY_PREFIX}{token}{suffix}"


def _sync_folder(path: Path) -> None:
    # Windows cannot open folders, and keeps names without this.
    if sys.platform == "win32":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def is_unused(root: Path) -> bool:
    """Whether a folder is empty, except for remnants of a writer that was killed before it wrote
    anything."""
    remnants = (TEMPORARY_PREFIX, LOCK)
    for path in root.rglob("*"):
        is_remnant = path.is_dir() or path.name.startswith(remnants)
        if not is_remnant:
            return False
    return True


def remove_unfinished(root: Path) -> int:
    """Remove the unfinished files of killed writers below ``root``, and return their number; only
    for the folder's writer."""
    # All files are listed before one is removed, because the listing goes on while it is read.
    candidates = list(root.rglob(f"{TEMPORARY_PREFIX}*"))
    unfinished = [path for path in candidates if path.is_file()]
    for path in unfinished:
        path.unlink(missing_ok=True)
    return len(unfinished)


@contextlib.contextmanager
def only_writer(root: Path, error: type[BricksError]) -> Iterator[None]:
    """Exclusive lock of a folder for one writer, released at the end of the process too. Raises
    ``error`` if another process holds it, WriteError if the folder cannot be written."""
    with _lock_file(root) as file:
        try:
            _lock(file.fileno())
        except OSError:
            raise error(
                f"another program writes into {root} at this moment; wait for its end or choose "
                "another folder"
            ) from None
        yield


@contextlib.contextmanager
def serialized(root: Path, timeout_s: float = 60.0) -> Iterator[None]:
    """Lock of a folder that other processes wait for; after ``timeout_s`` they continue without it.
    Raises WriteError if the folder cannot be written."""
    end_s = time.monotonic() + timeout_s
    with _lock_file(root) as file:
        while time.monotonic() < end_s:
            try:
                _lock(file.fileno())
                break
            except OSError:
                # A blocking lock would wait for ever for a process that hangs, so it is tried again
                # and again.
                time.sleep(0.05)
        yield


def _lock_file(root: Path) -> BinaryIO:
    with writing(root):
        root.mkdir(parents=True, exist_ok=True)
        # The file stays when its lock is released. Removing it would let two processes lock two
        # files of that name.
        return (root / LOCK).open("a+b")


if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
