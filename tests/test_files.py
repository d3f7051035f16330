"""Durable files."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from bricksrl.files import write_durably


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
