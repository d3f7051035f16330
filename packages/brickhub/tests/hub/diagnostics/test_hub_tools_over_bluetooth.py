"""Scan, check, latency and stop over the simulated radio."""

from __future__ import annotations

import time
from types import SimpleNamespace

import described
import pytest
from ble_world import NAME, World
from described import SPINNING, TWO_WHEELER

from brickhub.cli import main
from brickhub.finding import Outcome
from brickhub.hub.diagnostics.preflight import check_hub, check_robot, measure
from brickhub.hub.diagnostics.survey import survey_program, wheels_program
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transport import HubProgram
from brickhub.hub.transports.address import HubAddress
from brickhub.hub.transports.ble import scan
from brickhub.hub.transports.profile import PybricksCommand
from brickhub.robot import HubKind

pytestmark = pytest.mark.realtime


def test_scan_shows_kind_of_hub(world: World) -> None:
    assert [(hub.name, hub.kind) for hub in scan(0.3, backend=world.radio.backend())] == [
        (NAME, HubKind.PRIME)
    ]


def test_preflight_over_bluetooth(world: World) -> None:
    world.link(SPINNING)
    world.hub.library += [survey_program(TWO_WHEELER).source, wheels_program(TWO_WHEELER).source]
    findings = list(check_robot(world.transport(), TWO_WHEELER, SPINNING, may_move=lambda: True))
    told = {finding.name: finding for finding in findings}
    assert "4.0.1, profile 1.5" in told["firmware"].detail and told["hub"].outcome is Outcome.OK
    outcomes = {finding.outcome for finding in findings if not finding.name.startswith("wheel")}
    assert outcomes == {Outcome.OK}, findings
    assert told["wheel left"].outcome is Outcome.SKIPPED, "its hub lies still"
    assert told["motor left"].detail.startswith("moved by 30 deg")
    assert not world.hub.is_connected and not world.hub.is_running


def test_other_kind_of_hub_is_an_error() -> None:
    told = {
        "kind": HubKind.CITY,
        "firmware": "3.6.1",
        "profile_version": (1, 4),
        "name": NAME,
        "address": "x",
    }
    kind, firmware = check_hub(SimpleNamespace(**told), TWO_WHEELER)
    assert kind.outcome is Outcome.ERROR and "city hub" in kind.detail
    assert firmware.outcome is Outcome.WARNING and "3.6.1" in firmware.detail


@pytest.mark.parametrize(("interval_ms", "is_slow"), [(15.0, False), (45.0, True)])
def test_connection_interval_is_inferred(world: World, interval_ms: float, is_slow: bool) -> None:
    """The time for connecting is that of a real hub: two dozen exchanges at 45 ms nearly fill that
    of other tests, whose link is faster."""
    world.set_interval(interval_ms)
    with world.link(SPINNING, timeout_s=20.0, answer_timeout_s=5.0) as link:
        found = measure(link, SPINNING, 15)
    assert found.interval_ms == pytest.approx(interval_ms, abs=2.5)
    assert found.is_slow is is_slow


def test_any_program_can_be_stopped(world: World, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """Also a foreign one, over a link that another program left open."""
    other = (
        "from pybricks.parameters import Port\nfrom pybricks.pupdevices import Motor\n"
        "from pybricks.tools import wait\n"
    )
    other += "Motor(Port.A).run(500)\nwhile True:\n    wait(10)\n"
    world.hub.library.append(other)
    left = world.transport()
    left.open()
    left.start(HubProgram(other, 1))
    world.hub.wait_until("is_driven", True)
    monkeypatch.setattr(
        HubAddress, "transport", lambda self, *_: world.transport(name=None, address=self.which)
    )
    start_s = time.monotonic()
    assert main(("stop", "--hub", f"ble:{world.hub.address}")) == 0
    assert "the program was stopped" in capsys.readouterr().out
    assert not world.hub.is_driven and not world.hub.is_running
    assert time.monotonic() - start_s < 3.0
    assert PybricksCommand.STOP_USER_PROGRAM in world.hub.commands
    assert main(("stop", "--hub", f"ble:{world.hub.address}")) == 0
    assert "no program ran" in capsys.readouterr().out


def test_unreachable_hub_needs_button(
    world: World, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(
        HubAddress, "transport", lambda self, *_: world.transport(name="Rover", timeout_s=0.5)
    )
    assert main(("stop", "--hub", "ble:Rover")) == 2
    assert "hears only its button" in capsys.readouterr().err


def test_calibration_is_stored_by_address(
    world: World, monkeypatch: pytest.MonkeyPatch, capsys, tmp_path
) -> None:
    monkeypatch.setattr(HubAddress, "transport", lambda self, *_: world.transport())
    assert (
        main(
            (
                "calibrate",
                f"{described.__file__}:TWO_WHEELER",
                "--reverse",
                "left",
                "--calibrations",
                str(tmp_path),
            )
        )
        == 0
    )
    assert (tmp_path / world.hub.address.replace(":", "-") / "two-wheeler.json").exists()
    capsys.readouterr()


def test_link_uses_calibration_of_hub(world: World, tmp_path) -> None:
    from brickhub.hub.diagnostics.calibration import (
        Calibration,
        calibrated,
        calibration_of,
        save_calibration,
    )
    from brickhub.hub.program.generate import generate

    save_calibration(world.hub.address, TWO_WHEELER, Calibration({}, frozenset({"left"})), tmp_path)
    robot = calibrated(TWO_WHEELER, Calibration({}, frozenset({"left"})))
    world.hub.library.append(generate(robot, SPINNING).source)
    transport = world.transport()
    calibrate = calibration_of(transport, tmp_path)
    with HubLink(transport, TWO_WHEELER, SPINNING, calibrate=calibrate) as link:
        link.act([50, 50])
        assert "Direction.COUNTERCLOCKWISE" not in link.program.source
