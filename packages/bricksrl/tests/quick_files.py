"""Runs without what each of them waits for, and other tests show."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest

from bricksrl.plotting import save_image


@pytest.fixture(autouse=True, scope="module")  # so that it is there before a module's own runs
def quick_files() -> Iterator[None]:
    """Learning curves are one pixel (commands draw them: `test_train_command.py`), and disks are
    not waited for (brickhub's `test_files.py`)."""
    pixel = np.zeros((1, 1, 3), np.uint8)
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(
            "bricksrl.training.run_folder.RunFolder.draw_curve",
            lambda run, *_: save_image(run.curve_path, pixel),
        )
        monkeypatch.setattr(os, "fsync", lambda _: None)
        yield
