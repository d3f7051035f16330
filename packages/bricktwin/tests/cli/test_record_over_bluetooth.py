"""A motion log over the simulated radio."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from ble_world import World

from brickhub.hub.transports.address import HubAddress
from brickhub.target import whole_interface
from bricktwin.cli import main
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.motion_log import read_log

pytestmark = pytest.mark.realtime


def test_motion_log_over_bluetooth(
    world: World, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    interface = whole_interface(TWO_WHEELER)
    world.link(interface)
    monkeypatch.setattr(HubAddress, "transport", lambda self, *_: world.transport())
    path = tmp_path / "robot.jsonl"
    assert (
        main(
            (
                "twin",
                "record",
                "two-wheeler",
                "--hub",
                "ble",
                "--yes",
                "--steps",
                "60",
                "--out",
                str(path),
            )
        )
        == 0
    )
    log = read_log(path)
    assert log.interface == interface and log.commands.shape == (60, 2)
    assert any(abs(later - angle) > 5 for angle, later in itertools.pairwise(log.channels[:, 0])), (
        "it moved"
    )
    assert not world.hub.is_driven and not world.hub.is_running
