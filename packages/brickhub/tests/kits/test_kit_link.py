"""Link to virtual devices of LEGO's kits, through LEGO's package."""

from __future__ import annotations

import random
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from kit_world import DRIVE, ROBOT, TURN, connected

from brickhub.errors import HubError, HubNotFoundError, HubTimeoutError, StoppedError
from brickhub.hub.interface import Wait
from brickhub.hub.link.profiles import LinkProfile
from brickhub.hub.link.states import LinkState
from brickhub.kits.kit_protocol import FULL_SPEED_DEG_S, SUPERVISION_S
from brickhub.kits.link import HOLD_S, PERIOD_MS, KitLink
from brickhub.kits.virtual_kit import VirtualKit
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.machine import Pace

pytest.importorskip("legoeducation")
_MM_PER_DEG = 3.14159 * 56 / 360


@pytest.fixture
def driving() -> Iterator[tuple[VirtualKit, KitLink]]:
    """A robot that takes speeds."""
    kit, link = connected()
    yield kit, link
    link.close()


def speed_deg_s(kit: VirtualKit) -> float:
    """Mean speed of the right motor over 50 ms of the world."""
    before = kit.body.angle_mdeg("B")
    kit.sleep(0.05)
    return (kit.body.angle_mdeg("B") - before) / 50


def drive_on(link: KitLink) -> None:
    """Step until something fails."""
    while True:
        link.act((200, 0))


def test_steps_keep_their_time_and_readings_are_fresh(driving: tuple[VirtualKit, KitLink]) -> None:
    _, link = driving
    started_s = link.now_s()
    readings = [link.act((100, 0)) for _ in range(20)]
    assert link.now_s() - started_s == pytest.approx(2.0, abs=0.04)
    assert max(reading.age_s for reading in readings) <= 2 * PERIOD_MS / 1000
    assert [device.reports > 120 for device in link.devices.values()] == [True] * 3


@pytest.mark.parametrize(("interval_ms", "step_ms"), [(15.0, 60), (45.0, 90)])
def test_step_ends_with_reports_made_under_its_commands(interval_ms: float, step_ms: int) -> None:
    _, link = connected(replace(DRIVE, settle=Wait(60)), LinkProfile(interval_ms))
    with link:
        link.act((0, 0))
        started_s = link.now_s()
        for _ in range(10):
            link.act((200, 0))
        assert link.now_s() - started_s == pytest.approx(10 * step_ms / 1000, abs=0.02)


def test_python_ends_with_an_open_link() -> None:
    program = (
        "import kit_world\n_, link = kit_world.connected()\nclass Owner:\n"
        "  def __del__(self): link.close()\nowner = Owner()"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", program], cwd=Path(__file__).parent, timeout=30, check=False
        ).returncode
        == 0
    )


def test_speed_is_a_whole_percent(driving: tuple[VirtualKit, KitLink]) -> None:
    kit, link = driving
    for _ in range(10):
        values = link.act((100, 0)).values
    wanted_deg_s = round(100 * (100 / _MM_PER_DEG) / FULL_SPEED_DEG_S) * FULL_SPEED_DEG_S / 100
    assert speed_deg_s(kit) == pytest.approx(wanted_deg_s, abs=6)
    assert values[0] == pytest.approx(values[1], abs=4) and values[0] > 100


def test_turn_and_reading(driving: tuple[VirtualKit, KitLink]) -> None:
    _, link = driving
    for _ in range(10):
        values = link.act((0, 90)).values
    assert values[0] == pytest.approx(-values[1], abs=4) and values[0] > 50
    assert values[3] == pytest.approx(38, abs=1)


def test_moves_end_before_the_step_does() -> None:
    _, link = connected(TURN)
    with link:
        reading = link.act((90, -180))
        assert reading.values[0] == pytest.approx(90, abs=3)
        assert reading.values[2] == pytest.approx(-180, abs=3)
        assert 0.4 < reading.round_trip_s < 1.5


def test_commands_end_by_themselves(driving: tuple[VirtualKit, KitLink]) -> None:
    kit, link = driving
    for _ in range(5):
        link.act((200, 0))
    kit.sleep(HOLD_S + 0.15)
    assert speed_deg_s(kit) == 0


def test_lost_devices_stop_and_come_back(driving: tuple[VirtualKit, KitLink]) -> None:
    kit, link = driving
    link.act((200, 0))
    kit.in_reach = lambda: False
    lost_s = link.now_s()
    with pytest.raises(HubTimeoutError, match="Double Motor has been silent"):
        drive_on(link)
    assert link.now_s() - lost_s < 1.3
    assert speed_deg_s(kit) == 0
    assert link.state is LinkState.FAULT
    link.close()
    with pytest.raises(HubNotFoundError):
        link.open()
    kit.in_reach = lambda: True
    link.open()
    assert link.act((100, 0)).age_s < 0.1


def test_device_that_was_lost_for_long_stands(driving: tuple[VirtualKit, KitLink]) -> None:
    kit, _ = driving
    kit.in_reach = lambda: False
    kit.sleep(SUPERVISION_S + 1)
    assert not any(peer.device.is_connected for peer in kit.peers)


def test_emergency_stop_from_another_thread(driving: tuple[VirtualKit, KitLink]) -> None:
    kit, link = driving
    link.act((200, 0))
    thread = threading.Thread(target=link.emergency_stop)
    thread.start()
    thread.join()
    kit.sleep(0.1)
    assert speed_deg_s(kit) == 0
    with pytest.raises(StoppedError):
        link.act((200, 0))
    link.release()
    link.open()
    link.act((200, 0))


def test_rest_stops_the_motors(driving: tuple[VirtualKit, KitLink]) -> None:
    kit, link = driving
    link.act((200, 0))
    link.rest()
    kit.sleep(0.1)
    assert speed_deg_s(kit) == 0
    assert link.state is LinkState.READY


def test_two_robots_at_once() -> None:
    (_, first), (_, second) = connected(), connected()
    with first, second:
        for _ in range(5):
            ahead, back = first.act((100, 0)), second.act((-100, 0))
        assert ahead.values[0] > 20 and back.values[0] < -20


def course(faults: int, seed: int) -> int:
    """Draw faults at any time of a run of steps, each as long as drawn; returns how many steps
    ended as lost."""
    draw = random.Random(seed)
    kit, link = connected(DRIVE)
    lost = 0
    for _ in range(faults):
        begins_s = link.now_s() + draw.uniform(0, 0.5)
        ends_s = begins_s + draw.choice((0.02, 0.3, 0.8, 1.5, 30.0)) * draw.uniform(0.5, 1.5)
        kit.in_reach = lambda begins_s=begins_s, ends_s=ends_s: not begins_s <= kit.now_s() < ends_s
        while link.now_s() < ends_s + 0.3:
            is_step = False
            try:
                link.open()
                is_step = True
                link.act((draw.uniform(-200, 200), draw.uniform(-90, 90)))
            except HubError:
                lost += is_step
                link.close()
                kit.sleep(HOLD_S + 0.25)
                assert abs(speed_deg_s(kit)) < 10
                kit.sleep(0.5)
    assert link.is_open or link.open() is None
    link.close()
    return lost


def test_drawn_faults_leave_no_step_hanging() -> None:
    assert course(12, seed=3) > 3


def test_in_real_time_the_world_catches_up_with_what_took_long_outside() -> None:
    wall_s = 0.0

    def sleep(seconds: float) -> None:
        nonlocal wall_s
        wall_s += seconds

    kit = VirtualKit(BenchBody(ROBOT, {"light": lambda angles: 50}), realtime=True)
    kit._pace = Pace(lambda: wall_s, sleep)
    kit.sleep(0.5)
    assert kit.now_s() == pytest.approx(0.5, abs=0.011)
    wall_s = 2.0
    kit.sleep(0.1)
    assert kit.now_s() == pytest.approx(2.0, abs=0.011)
