"""Fixtures of Bluetooth tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from brickhub.hub.program import generate

if TYPE_CHECKING:
    from ble_world import World


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    """A two-wheeler's hub with a watchdog of half a second and a fast link."""
    from ble_world import World

    monkeypatch.setattr(generate, "END_MS", 500)
    made = World(tmp_path)
    yield made
    made.close()
