"""Durable files."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from bricksrl.errors import DataError
from bricksrl.files import check_writable, write_durably


def test_error_names_the_file_that_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the temporary one, of which a user knows nothing."""

    def full(_handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_durably(tmp_path / "new/curve.png", b"picture")
    assert caught.value.filename == str(tmp_path / "new/curve.png")
    assert not list((tmp_path / "new").iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(OSError) as caught:  # noqa: PT011  which one depends on the system
        write_durably(tmp_path / "file/curve.png", b"picture")
    assert caught.value.filename == str(tmp_path / "file/curve.png")


def test_check_writable_makes_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    for path in (tmp_path / "new" / "folder" / "file", tmp_path / "new", tmp_path / "file"):
        check_writable(path, DataError)
    refused = {tmp_path: "is a folder", tmp_path / "file" / "new": "cannot write", tmp_path / ("x" * 300): "cannot write"}
    for path, reason in refused.items():
        with pytest.raises(DataError, match=reason):
            check_writable(path, DataError)
    assert [path.name for path in tmp_path.iterdir()] == ["file"] and (tmp_path / "file").read_text() == "kept"
