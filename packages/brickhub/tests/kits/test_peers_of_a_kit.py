"""Virtual devices as LEGO's package sees them: packets on their way, lost links, and time."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
from kit_world import ROBOT, encode

from brickhub.errors import HubNotFoundError, HubTimeoutError
from brickhub.hub.link.profiles import IDEAL, LinkProfile
from brickhub.kits.kit_protocol import NOTIFICATION, Product
from brickhub.kits.radio import KitPart
from brickhub.kits.virtual_kit import Peer, VirtualKit, virtual_robot
from brickhub.robot import HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

GONE: list[str] = []


def made(**options: Any) -> VirtualKit:
    """A kit over a link without delays."""
    body = BenchBody(ROBOT, readings={"light": lambda angles: 50.0})
    return VirtualKit(body, **({"link": IDEAL} | options))


async def nowhere(characteristic: object, packet: bytes) -> None:
    """A function of LEGO's package that is given packets."""


def connected(peer: Peer) -> bool:
    """Connect, in a loop as of LEGO's package."""

    async def connect() -> bool:
        return peer.connect(nowhere, lambda: GONE.append(peer.name))

    GONE.clear()
    return asyncio.run(connect())


def answers(kit: VirtualKit, steps: int = 1) -> list[bytes]:
    """Packets that arrive in some control steps, without notifications."""
    arrived = [packet for _ in range(steps) for _, packet in kit.step()]
    return [packet for packet in arrived if packet[0] != NOTIFICATION]


def test_packets_go_to_a_device_and_its_answers_come_back() -> None:
    kit = made()
    single = kit.peers[1]
    assert connected(single)
    assert kit.package_thread == threading.get_ident()
    single.send(encode("info"))
    single.send(encode("run_for_time", 1, 100, 0))
    assert [packet[0] for packet in answers(kit)] == [1]
    assert kit.machine.time_ms == 5
    assert answers(kit, 18) == []
    assert [packet[0] for packet in answers(kit, 6)] == [127]


def test_packets_wait_for_connection_events() -> None:
    kit = made(link=LinkProfile(45.0))
    single = kit.peers[1]
    connected(single)
    single.send(encode("info"))
    early = answers(kit, 8)
    assert early == []
    late = answers(kit, 20)
    assert [packet[0] for packet in late] == [1]


def test_device_out_of_reach_is_neither_connected_nor_found() -> None:
    kit = made()
    part = KitPart(Product.SINGLE_MOTOR, "C")
    assert kit.search(part) == {"device": kit.peers[1]}
    with pytest.raises(KeyError):
        kit.search(KitPart(Product.SINGLE_MOTOR, "E"))
    kit.in_reach = lambda: False
    assert not connected(kit.peers[1])
    says = "no Single Motor is in reach; switch it on, and bring it near"
    with pytest.raises(HubNotFoundError, match=says):
        kit.search(part)


def test_lost_link_stays_lost_until_it_is_made_anew() -> None:
    kit = made()
    single = kit.peers[1]
    connected(single)
    single.send(encode("run", 1, 0))
    assert len(answers(kit, 100)) == 1
    kit.in_reach = lambda: False
    single.send(encode("stop", 1))
    assert answers(kit, 10) == []
    kit.in_reach = lambda: True
    single.send(encode("stop", 1))
    assert answers(kit, 10) == []
    # The device goes on with its last command, until it takes its link for lost.
    assert single.device.is_connected
    kit.sleep(23.5)
    assert single.device.is_connected
    before_mdeg = kit.body.angle_mdeg("C")
    kit.sleep(0.2)
    assert kit.body.angle_mdeg("C") > before_mdeg + 50_000
    kit.sleep(1.0)
    assert not single.device.is_connected
    kit.sleep(0.5)
    before_mdeg = kit.body.angle_mdeg("C")
    kit.sleep(0.2)
    assert kit.body.angle_mdeg("C") == before_mdeg
    assert connected(single)
    single.send(encode("info"))
    assert [packet[0] for packet in answers(kit, 2)] == [1]


def test_what_was_on_its_way_is_lost_with_its_link() -> None:
    kit = made(link=LinkProfile(45.0))
    single = kit.peers[1]
    connected(single)
    single.send(encode("info"))
    single.disconnect()
    assert GONE == ["Single Motor"]
    single.disconnect()
    assert GONE == ["Single Motor"]
    assert not single.device.is_connected
    connected(single)
    assert answers(kit, 40) == []


def test_device_out_of_reach_does_not_hear_of_the_end() -> None:
    kit = made()
    single = kit.peers[1]
    connected(single)
    kit.in_reach = lambda: False
    single.disconnect()
    assert GONE == ["Single Motor"]
    assert single.device.is_connected


def test_world_goes_on_in_control_steps() -> None:
    kit = made()
    kit.sleep(0.012)
    assert (kit.machine.time_ms, kit.now_s()) == (15, 0.015)
    kit.sleep(0.0)
    assert kit.machine.time_ms == 15


def test_function_that_waits_lets_the_world_go_on() -> None:
    kit = made()

    def work() -> float:
        kit.wait(0.5)
        return kit.now_s()

    assert kit.run(work) == pytest.approx(0.5, abs=0.006)

    def fail() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        kit.run(fail)


def test_function_that_waits_for_too_long_is_stopped() -> None:
    kit = made()
    connected(kit.peers[1])
    ended: list[str] = []

    def work() -> None:
        try:
            kit.wait(100.0)
        except SystemExit:
            ended.append("stopped")
            raise

    with pytest.raises(HubTimeoutError, match="nothing answered within 2.5 s; check that the devi"):
        kit.run(work, 2.5)
    assert kit.now_s() == pytest.approx(2.5, abs=0.006)
    assert not kit.peers[1].device.is_connected
    for thread in threading.enumerate():
        if thread.name == "program":
            thread.join(10.0)
    assert ended == ["stopped"]
    with pytest.raises(SystemExit):
        kit.check_stopped()


def test_kind_of_a_virtual_robot_is_that_of_its_body() -> None:
    kit = virtual_robot(BenchBody(ROBOT, readings={"light": lambda angles: 50.0}), seed=3)
    assert isinstance(kit, VirtualKit)
    assert not kit.is_realtime
    hub = virtual_robot(BenchBody(Robot("rover", HubKind.PRIME)), link=IDEAL, realtime=True)
    assert isinstance(hub, VirtualHub)


def test_link_is_that_of_the_body_unless_it_is_given() -> None:
    body = BenchBody(ROBOT, readings={"light": lambda angles: 50.0})
    assert VirtualKit(body).link is body.link
    assert VirtualKit(body, link=IDEAL).link is IDEAL
