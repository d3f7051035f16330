"""Durable files."""

from __future__ import annotations

import errno
import os
import pickle
import shlex
import struct
import sys
import time
from pathlib import Path

import pytest

from brickhub.errors import DescriptionError, PlanError, TwinError, UnknownNameError, WriteError
from brickhub.files import (
    as_file_name,
    atomic_folder,
    check_writable,
    folder_with,
    is_unused,
    only_writer,
    parsing,
    quoted,
    reading,
    refuse_existing,
    remove_unfinished,
    serialized,
    user_cache,
    write_durably,
)


def test_error_names_the_file_that_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the temporary one, of which a user knows nothing."""

    def full(_handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        WriteError,
        match=r"cannot write .*new.curve.png \(No space left .*\); make room on that disk, or name",
    ):
        write_durably(tmp_path / "new/curve.png", b"picture")
    with (
        pytest.raises(WriteError, match=r"cannot write .*new.data \(No space left"),
        atomic_folder(tmp_path / "new/data") as folder,
    ):
        write_durably(folder / "rows", b"")
    assert not list((tmp_path / "new").iterdir())
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "deep" / "er" / "data"):
        raise KeyboardInterrupt
    assert not (tmp_path / "deep").exists()
    (tmp_path / "file").touch()
    with pytest.raises(
        WriteError, match=r"cannot write .*file.curve.png \(.*\); name another place"
    ) as caught:
        write_durably(tmp_path / "file/curve.png", b"picture")
    assert (
        isinstance(caught.value, OSError)
        and caught.value.strerror
        and "\n" not in str(caught.value)
    )


def test_message_names_folders_that_were_meant(tmp_path: Path) -> None:
    assert folder_with(tmp_path / "none" / "none", "config.json") == "a folder with a config.json"
    for age, name in enumerate(("walk", "run-3", "run-2", "run-1")):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "config.json").touch()
        os.utime(tmp_path / "runs" / name, (1000 - age, 1000 - age))
    names = " or ".join(str(tmp_path / "runs" / name) for name in ("walk", "run-3", "run-2"))
    assert (
        folder_with(tmp_path / "runs", "config.json")
        == f"a folder with a config.json, such as {names}"
    )
    for inner in ("data", "config.json"):
        assert folder_with(tmp_path / "runs" / "walk" / inner, "config.json").endswith(
            f", such as {tmp_path / 'runs' / 'walk'}"
        )
    assert folder_with(tmp_path / "runs" / "wlk", "config.json").endswith(
        f", such as {tmp_path / 'runs' / 'walk'}"
    )


def test_check_writable_makes_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    for path in (tmp_path / "new" / "folder" / "file", tmp_path / "new", tmp_path / "file"):
        check_writable(path)
    refused = {
        tmp_path: "it is a folder",
        tmp_path / "file" / "new": "cannot write",
        tmp_path / ("x" * 300): "cannot write",
    }
    for path, reason in refused.items():
        with pytest.raises(WriteError, match=reason):
            check_writable(path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"] and (
        tmp_path / "file"
    ).read_text() == "kept"


@pytest.mark.skipif(sys.platform == "win32", reason="modes are of POSIX")
@pytest.mark.parametrize(
    ("umask", "file_mode", "folder_mode"),
    [(0o022, 0o644, 0o755), (0o077, 0o600, 0o700), (0o002, 0o664, 0o775)],
)
def test_files_and_folders_respect_the_umask(
    tmp_path: Path, umask: int, file_mode: int, folder_mode: int
) -> None:
    before = os.umask(umask)
    try:
        write_durably(tmp_path / "file", b"1")
        with atomic_folder(tmp_path / "folder") as folder:
            write_durably(folder / "file", b"1")
    finally:
        os.umask(before)
    modes = [
        path.stat().st_mode & 0o777
        for path in (tmp_path / "file", tmp_path / "folder", tmp_path / "folder/file")
    ]
    assert modes == [file_mode, folder_mode, file_mode]


@pytest.mark.skipif(sys.platform == "win32", reason="modes are of POSIX")
def test_a_file_that_is_written_anew_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch(0o600)
    path.chmod(0o640)
    write_durably(path, b"1")
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("refusals", [0, 1, 3])
def test_windows_waits_for_a_reader_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refusals: int
) -> None:
    """There a file that another program reads cannot be replaced, nor a folder renamed."""
    replace = Path.replace
    left = 2 * [refusals]

    def refusing(path: Path, target: Path) -> Path:
        left[-1] -= 1
        if left[-1] >= 0:
            raise PermissionError(errno.EACCES, "Access is denied")
        left.pop()
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", refusing)
    monkeypatch.setattr("sys.platform", "win32")
    write_durably(tmp_path / "file", b"1")
    with atomic_folder(tmp_path / "folder") as folder:
        (folder / "inside").touch()
    assert (tmp_path / "file").read_bytes() == b"1" and not left
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder", "inside"]


@pytest.mark.parametrize("platform", ["linux", "win32"])
def test_file_that_stays_open_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, platform: str
) -> None:
    def refuse(_path: Path, _target: Path) -> Path:
        raise PermissionError(errno.EACCES, "Access is denied")

    monkeypatch.setattr(Path, "replace", refuse)
    monkeypatch.setattr("sys.platform", platform)
    monkeypatch.setattr("brickhub.files._REPLACE_S", 0.05)
    remedy = "close the program that has it open, or name" if platform == "win32" else "name"
    with pytest.raises(WriteError, match=rf"cannot write .*file \(Access is denied\); {remedy}"):
        write_durably(tmp_path / "file", b"1")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("path", "word"),
    [
        (r"C:\runs\walk-1", r"C:\runs\walk-1"),
        (r"C:\my runs\walk", r'"C:\my runs\walk"'),
        (r"C:\R&D\walk", r'"C:\R&D\walk"'),
        ("walk(2)", '"walk(2)"'),
        ("a;b,c", '"a;b,c"'),
        ("Eva's", '"Eva\'s"'),
        (r"runs\größe", r"runs\größe"),
        ("", '""'),
    ],
)
def test_path_is_one_word_in_shells_of_windows(
    monkeypatch: pytest.MonkeyPatch, path: str, word: str
) -> None:
    monkeypatch.setattr("sys.platform", "win32")
    assert quoted(path) == word


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("COM3", "COM3-"),
        ("con", "con-"),
        ("Aux", "Aux-"),
        ("lpt9", "lpt9-"),
        ("/dev/ttyACM0", "-dev-ttyACM0"),
        ("90:84:2B:01:02:03", "90-84-2B-01-02-03"),
        ("COM33", "COM33"),
        ("console", "console"),
        ("walk. ", "walk-"),
    ],
)
def test_text_as_a_file_name_of_every_system(text: str, name: str) -> None:
    """Windows has devices in every folder, of these names with any ending."""
    assert as_file_name(text) == name


def test_a_folder_is_unused_with_remnants_alone(tmp_path: Path) -> None:
    assert is_unused(tmp_path) and is_unused(tmp_path / "missing")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / ".part-01").touch()
    (tmp_path / ".part-02").mkdir()
    (tmp_path / ".lock").touch()
    assert is_unused(tmp_path)
    (tmp_path / "inner" / "rows").touch()
    assert not is_unused(tmp_path)
    # folders are whole: only their writer's caller knows whether they are wanted
    assert remove_unfinished(tmp_path) == 1
    assert sorted(path.name for path in tmp_path.rglob("*")) == [
        ".lock",
        ".part-02",
        "inner",
        "rows",
    ]
    assert remove_unfinished(tmp_path) == 0


def test_what_exists_is_refused(tmp_path: Path) -> None:
    refuse_existing(tmp_path / "new", TwinError)
    with pytest.raises(TwinError, match="exists already; choose another name"):
        refuse_existing(tmp_path, TwinError)


def test_one_writer_and_what_waits_for_it(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    with only_writer(folder, TwinError):
        with (
            pytest.raises(TwinError, match="another program writes into"),
            only_writer(folder, TwinError),
        ):
            pass
        begin_s = time.monotonic()
        with serialized(folder, timeout_s=0.12):
            assert 0.1 < time.monotonic() - begin_s < 10.0, "goes on without the lock"
    begin_s = time.monotonic()
    with serialized(folder):
        assert time.monotonic() - begin_s < 10.0
        with pytest.raises(TwinError), only_writer(folder, TwinError):
            pass
    with only_writer(folder, TwinError):
        assert [path.name for path in folder.iterdir()] == [".lock"]


ERRORS = (
    ValueError("x"),
    KeyError("x"),
    RecursionError(),
    OverflowError(),
    ZeroDivisionError(),
    AssertionError(),
    struct.error("x"),
    pickle.UnpicklingError("x"),
)


@pytest.mark.parametrize("error", ERRORS, ids=repr)
def test_any_error_of_a_file_is_one_refusal(error: Exception) -> None:
    with (
        pytest.raises(TwinError, match=r"^cannot read the log a\.json \(it is not JSON"),
        reading("the log", "a.json", TwinError, "give another"),
    ):
        raise error
    with pytest.raises(TwinError, match="^no log$"), parsing(TwinError("no log")):
        raise error


@pytest.mark.parametrize("error", [DescriptionError("no mass"), UnknownNameError("no mass")])
def test_refusal_says_what_we_know_of_the_file(error: Exception) -> None:
    with (
        pytest.raises(TwinError, match=r"\(no mass\); give another"),
        reading("the log", "a.json", TwinError, "give another"),
    ):
        raise error


@pytest.mark.parametrize("error", [TwinError("of another version"), MemoryError("too large")])
def test_what_is_not_wrong_with_the_file_stays(error: Exception) -> None:
    with pytest.raises(type(error), match=str(error)), reading("it", "a", PlanError, "give"):
        raise error


def test_more_precise_refusal_stays() -> None:
    with pytest.raises(TwinError, match="too many rows"), parsing(TwinError("no log")):
        raise TwinError("too many rows")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_what_is_no_file_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    """As root, /dev/null would become a file."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_durably(pipe, b"data")
    assert os.read(reader, 10) == b"data" and pipe.is_fifo()
    os.close(reader)
    assert list(tmp_path.iterdir()) == [pipe]


def test_what_is_kept_lies_in_the_users_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert user_cache() == Path("/somewhere/bricksrl")
    monkeypatch.setattr(Path, "home", lambda: Path("/home/ada"))
    for value in ("", None):
        if value is None:
            monkeypatch.delenv("XDG_CACHE_HOME")
        else:
            monkeypatch.setenv("XDG_CACHE_HOME", value)
        assert user_cache() == Path("/home/ada/.cache/bricksrl")


@pytest.mark.parametrize("path", ["plain.py", "with space.py", "it's.py", "$HOME&.py"])
def test_path_is_one_word_in_other_shells(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    assert shlex.split(quoted(Path(path))) == [path]
    assert (quoted(path) == path) is (path == "plain.py")


@pytest.mark.parametrize(
    ("failure", "reason"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file", "x"), "No such file"),
        (OSError("the disk is gone"), "the disk is gone"),
    ],
)
def test_a_refusal_has_the_systems_reason(failure: OSError, reason: str) -> None:
    with (
        pytest.raises(PlanError, match=rf"^cannot read the plan a\.ldr \({reason}\); mend it$"),
        reading("the plan", "a.ldr", PlanError, "mend it"),
    ):
        raise failure
