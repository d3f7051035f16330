"""Files that a program writes over its output."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path

import pytest

from brickhub.hub.program.program_files import ProgramFiles, why_unsafe


def sent(folder: Path, *pieces: bytes) -> tuple[bytes, list[str]]:
    """What is printed of the output, and what is told."""
    printed, told = io.BytesIO(), []
    files = ProgramFiles(printed, folder, told.append)
    for piece in pieces:
        files.write(piece)
    files.close()
    return printed.getvalue(), told


@pytest.mark.parametrize("size", [1, 3, 1000])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_files_are_saved_and_the_rest_is_printed(tmp_path: Path, size: int, end: bytes) -> None:
    lines = (
        b"on",
        b"PB_OF:logs/servo.txt",
        b"1, 2",
        b"",
        b"PB_EOF",
        b"_file_begin_ track.csv",
        b"0,5",
        b"_file_end_",
        b"PB_",
        b"off",
    )
    data = end.join(lines)
    pieces = [data[start : start + size] for start in range(0, len(data), size)]
    printed, told = sent(tmp_path, *pieces)
    assert printed.replace(b"\r\n", b"\n") == b"on\nPB_\noff"
    assert (tmp_path / "logs/servo.txt").read_bytes() == b"1, 2\n\n"
    assert (tmp_path / "track.csv").read_bytes() == b"0,5\n"
    assert told == [
        f"saved {tmp_path}/logs/servo.txt (2 lines)",
        f"saved {tmp_path}/track.csv (1 line)",
    ]


def test_a_prompt_is_printed_at_once(tmp_path: Path) -> None:
    printed = io.BytesIO()
    files = ProgramFiles(printed, tmp_path, print)
    files.write(b"name? ")
    assert printed.getvalue() == b"name? "
    files.write(b"PB_OF:no.txt\n")  # within a line it is text
    assert printed.getvalue() == b"name? PB_OF:no.txt\n" and not list(tmp_path.iterdir())


def test_unfinished_and_doubly_begun_files_are_kept(tmp_path: Path) -> None:
    printed, told = sent(tmp_path, b"PB_EOF\nPB_OF:a.txt\n1\nPB_OF:b.txt\n2")
    assert (tmp_path / "a.txt").read_text() == "1\n" and (tmp_path / "b.txt").read_text() == "2\n"
    assert printed == b"PB_EOF\n" and len(told) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="links and named pipes of POSIX")
@pytest.mark.parametrize(
    "name",
    [
        *(
            "../up.txt",
            "/etc/up.txt",
            "a/../../up.txt",
            "..",
            "",
            " ",
            "~/up.txt",
            "C:up.txt",
            r"C:\up.txt",
            r"..\up.txt",
        ),
        *(
            ".bashrc",
            ".git/hooks/post-commit",
            "main.py",
            "evil.PY",
            "conftest.py",
            "x.pth",
            "run.sh",
            "a.so",
            "x.py. ",
            "x.bat",
        ),
        *(
            "con",
            "NUL.txt",
            "a/com1.csv",
            "log.txt:hidden",
            "a\0b.txt",
            "a\x1b[2J.txt",
            "Makefile",
            "folder",
            "link.txt",
            "out/x.txt",
        ),
        *("x" * 300 + ".txt", "pipe.txt", "pyproject.toml", "setup.cfg"),
    ],
)
def test_a_program_writes_nowhere_else(tmp_path: Path, name: str) -> None:
    folder, outside = tmp_path / "mine", tmp_path / "outside"
    (folder / "folder").mkdir(parents=True)
    outside.mkdir()
    (folder / "Makefile").write_text("all:\n")
    (folder / "link.txt").symlink_to(outside / "x.txt")
    (folder / "out").symlink_to(outside)
    os.mkfifo(folder / "pipe.txt")
    before = sorted(tmp_path.rglob("*"))
    printed, told = sent(folder, b"PB_OF:" + name.encode() + b"\nrow\nPB_EOF\n")
    assert sorted(tmp_path.rglob("*")) == before and (folder / "Makefile").read_text() == "all:\n"
    assert b"row\n" in printed, "nothing is lost"
    assert len(told) == 1 and "was not saved, but printed (" in told[0] and told[0].isprintable()


def test_a_log_is_replaced_by_that_of_the_next_run(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_text("old")
    assert why_unsafe("log.txt", tmp_path) is None and why_unsafe("servo", tmp_path) is None
    sent(tmp_path, b"PB_OF:log.txt\nnew\nPB_EOF\n")
    assert (tmp_path / "log.txt").read_text() == "new\n"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("log.csv", None),
        ("logs/deep/log.csv", None),
        ("log", None),
        ("", "it is no name"),
        ("a\tb.txt", "it is no name"),
        ("/log.csv", "it is outside of the program's folder"),
        ("\\log.csv", "it is outside of the program's folder"),
        ("~/log.csv", "it is outside of the program's folder"),
        ("C:/log.csv", "it is outside of the program's folder"),
        ("a/../log.csv", "it is outside of the program's folder"),
        ("a\\log.csv", "it has a backslash or a colon; separate folders by /"),
        ("a/b:log.csv", "it has a backslash or a colon; separate folders by /"),
        (".log.csv", "it is hidden"),
        ("a/.git/log.csv", "it is hidden"),
        ("con.csv", "it is a device of Windows"),
        ("aux/log.csv", "it is a device of Windows"),
        ("log.py", "a computer runs such files"),
        ("log.PY", "a computer runs such files"),
        ("log.py. .", "a computer runs such files"),
        ("a/run.bat", "a computer runs such files"),
    ],
)
def test_reason_why_a_name_is_refused(tmp_path: Path, name: str, why: str | None) -> None:
    assert why_unsafe(name, tmp_path) == why


def test_what_is_there_may_be_replaced_if_it_is_a_table_or_a_text(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    assert why_unsafe("folder.csv", tmp_path) == "there is something else of that name"
    for name in ("a.csv", "a.dat", "a.json", "a.jsonl", "a.log", "a.md", "a.tsv", "a.txt", "a.TXT"):
        (tmp_path / name).touch()
        assert why_unsafe(name, tmp_path) is None
    for name in ("plain", "picture.png", "table.xlsx"):
        assert why_unsafe(name, tmp_path) is None
        (tmp_path / name).touch()
        assert why_unsafe(name, tmp_path) == "there is such a file, which is no table or text"


def test_refused_file_is_told_and_printed(tmp_path: Path) -> None:
    name = "x" * 100 + ".py"
    printed, told = sent(tmp_path, f"PB_OF:{name}\n1\nPB_EOF\nend\n".encode())
    assert printed == f"PB_OF:{name}\n1\nPB_EOF\nend\n".encode()
    shown = repr("x" * 80)
    refused = f"the program's file {shown} was not saved, but printed (a computer runs such files)"
    assert told == [f"{refused}; choose a name such as log.csv"]
    (tmp_path / "file").touch()
    _, told = sent(tmp_path, b"PB_OF:file/log.csv\n1\nPB_EOF\n")
    assert told[0].startswith("the program's file 'file/log.csv' was not saved, but printed (")
