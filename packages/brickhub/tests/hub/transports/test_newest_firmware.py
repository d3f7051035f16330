"""Newer firmware, hubs of other makers, and Pybricks' own service, over Bluetooth."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from ble_world import World, bounded

from brickhub.errors import HubNotFoundError, HubTakenError, Reason
from brickhub.finding import Outcome
from brickhub.hub.diagnostics.preflight import check_hub
from brickhub.hub.transports import ble, profile
from brickhub.hub.transports.ble import find
from brickhub.robot import HubKind


@pytest.mark.parametrize("version", ["1.8.0", "2.0.0"])
def test_newer_profile_is_told_and_used(
    world: World, caplog: pytest.LogCaptureFixture, version: str
) -> None:
    world.hub.profile_version = version
    with caplog.at_level(logging.WARNING), world.link() as link:
        link.act([20.0])
        firmware = next(
            found
            for found in check_hub(link._transport.identity, world.robot)
            if found.name == "firmware"
        )
    assert firmware.outcome is Outcome.WARNING and "newer than this brickhub" in firmware.detail
    assert f"Pybricks Profile {version[:3]}, newer than the known 1.7" in caplog.text


def test_newest_known_profile_is_not_remarked(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.hub.profile_version = "1.7.0"
    with caplog.at_level(logging.WARNING):
        world.transport().open()
    assert "newer" not in caplog.text


def test_telemetry_is_ignored() -> None:
    assert profile.parse_event(b"\x03\x01\x02") is None


def test_peak_hub_is_known_by_its_name() -> None:
    assert profile.parse_hub_kind(b"", "Peak-1A2B") is HubKind.PRIME


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The socket on which Pybricks' service listens."""
    if sys.platform == "win32":
        pytest.skip("Windows has a named pipe")
    with (
        tempfile.TemporaryDirectory(dir="/tmp") as folder,  # macOS takes 103 characters at most
        contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)) as listener,
    ):
        monkeypatch.setenv("PB_RUNTIME_DIR", folder)
        listener.bind(str(ble.socket_path()))
        listener.listen()
        yield


def test_hub_of_the_service_is_told_with_its_release(world: World, service: None) -> None:
    world.transport().open()
    error = bounded(
        lambda: asyncio.run(find(None, None, 1.0, world.radio.backend())), HubTakenError
    )
    assert error.reason is Reason.TAKEN and error.reason.is_lasting
    assert (
        "is connected to Pybricks' own" in str(error)
        and "`pb disconnect`" in str(error)
        and "`pb service stop`" in str(error)
    )


def test_missing_hub_may_be_with_the_service(world: World, service: None) -> None:
    error = bounded(
        lambda: asyncio.run(find("Rover", None, 0.3, world.radio.backend())), HubNotFoundError
    )
    assert "may have it" in str(error) and "`pb disconnect`" in str(error)


def test_without_the_service_nothing_is_said_of_it(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PB_RUNTIME_DIR", str(tmp_path))
    assert not ble.service_is_running()
    assert "service" not in str(
        bounded(
            lambda: asyncio.run(find("Rover", None, 0.3, world.radio.backend())), HubNotFoundError
        )
    )


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has a named pipe")
def test_socket_is_where_pybricks_core_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PB_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/1000")
    assert ble.socket_path() == Path("/run/user/1000/pybricks/pb-service.sock")
    monkeypatch.setattr("sys.platform", "darwin")
    assert ble.socket_path().parent.name.startswith("pybricks-")
