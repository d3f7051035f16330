"""Runs without what each of them waits for, and other tests show."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from brickhub.files import write_durably

# A picture of one pixel: that of Matplotlib would need its import, which takes a second.
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c49444154789c63606060000000040001f61738550000000049454e44ae426082"
)


@pytest.fixture(autouse=True, scope="module")  # so that it is there before a module's own runs
def quick_files() -> Iterator[None]:
    """Learning curves are one pixel (commands draw them: `test_train_command.py`), and disks are
    not waited for (brickhub's `test_files.py`)."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(
            "bricksrl.training.run_folder.RunFolder.draw_curve",
            lambda run, *_: write_durably(run.curve_path, PIXEL),
        )
        monkeypatch.setattr(os, "fsync", lambda _: None)
        yield
