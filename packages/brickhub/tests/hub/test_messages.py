"""Numbers that robots tell one another: through the generated programs of their hubs."""

from __future__ import annotations

from dataclasses import replace

import pytest
from described import TWO_WHEELER

from brickhub.errors import DescriptionError
from brickhub.hub.interface import Interface, MotorAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import IDEAL
from brickhub.hub.messages import Exchange
from brickhub.hub.program.generate import generate
from brickhub.robot import HubKind
from brickhub.virtual.air import INTERVAL_MS, LASTS_MS, Air
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

STEP_MS = 300
ANGLES = (MotorAngle("left"),)


class Pair:
    """Two hubs in one room, each with a program that was generated for it."""

    def __init__(self, numbers: int = 2) -> None:
        self.hubs = []
        self.links = []
        for own, other in ((5, 9), (9, 5)):
            exchange = Exchange(own, (other,), numbers)
            interface = Interface(exchange.commands, (*ANGLES, *exchange.channels), Wait(STEP_MS))
            hub = VirtualHub(BenchBody(TWO_WHEELER), link=IDEAL)
            hub.waits_for_acknowledgement = False
            self.hubs.append(hub)
            self.links.append(HubLink(hub, TWO_WHEELER, interface))
        antennas = [hub.machine.antenna for hub in self.hubs]
        self.air = Air(antennas, lambda one, other: 1.0)
        for link in self.links:
            link.open()

    def step(self, *told: list[float]) -> list[list[float]]:
        """What each hub has heard after a step: without the angle of its motor."""
        for link, numbers in zip(self.links, told, strict=True):
            link.send(numbers)
        self.pass_time(STEP_MS - 5)
        return [list(link.receive().values)[1:] for link in self.links]

    def pass_time(self, duration_ms: int) -> None:
        """Let both hubs run, so that neither is ahead of what it can hear."""
        start_ms = self.hubs[0].machine.time_ms
        for time_ms in range(start_ms, start_ms + duration_ms, 5):
            for hub in self.hubs:
                hub.run_on_until(time_ms)
            self.air.carry(time_ms)


def test_each_hub_answers_what_the_other_told() -> None:
    pair = Pair()
    heard = [pair.step([0.25, -1.0], [0.0, 0.5]) for _ in range(2)]
    assert heard[-1] == [[0.0, 0.5], [0.25, -1.0]]
    first, second = pair.step([1.0, 0.07], [-0.3, 0.5])
    assert first == pytest.approx([-0.3, 0.5]) and second == pytest.approx([1.0, 0.07])


def test_numbers_beyond_the_range_are_clamped_and_those_between_hundredths_rounded() -> None:
    pair = Pair(numbers=1)
    first, second = pair.step([5.0], [0.123])
    assert first == pytest.approx([0.12]) and second == [1.0]


def test_nothing_is_heard_before_a_broadcast_and_a_second_after_it() -> None:
    pair = Pair()
    assert [list(link.read().values)[1:] for link in pair.links] == [[0.0, 0.0]] * 2
    assert pair.step([1.0, 1.0], [1.0, 1.0])[0] == [1.0, 1.0]
    pair.links[1].close()
    for _ in range((LASTS_MS + 2 * int(INTERVAL_MS)) // 300 + 1):
        pair.links[0].send([0.0, 0.0])
        pair.pass_time(STEP_MS - 5)
        values = pair.links[0].receive().values
    assert list(values)[1:] == [0.0, 0.0], "the hub that has ended is silent"


@pytest.mark.parametrize("message", [True, 7, "ab", (1, 2, 3), ("a", 2), (1, 2.5), b"xy"])
def test_what_other_programs_say_on_the_channel_is_no_number(message: object) -> None:
    pair = Pair()
    pair.step([0.0, 0.0], [0.0, 0.0])
    pair.hubs[1].machine.antenna.changes.clear()
    pair.hubs[0].machine.antenna.heard[9].take(pair.hubs[0].machine.time_ms, message, -50)
    assert list(pair.links[0].read().values)[1:] == [0.0, 0.0]
    pair.hubs[0].machine.antenna.heard[9].take(pair.hubs[0].machine.time_ms, (9000, -3), -50)
    assert list(pair.links[0].read().values)[1:] == pytest.approx([1.0, -0.03])


def test_a_lone_hub_keeps_only_what_it_broadcast_last() -> None:
    exchange = Exchange(0, (1,), 1)
    hub = VirtualHub(BenchBody(TWO_WHEELER), link=IDEAL)
    link = HubLink(hub, TWO_WHEELER, Interface(exchange.commands, ANGLES, Wait(20)))
    link.open()
    for number in range(5):
        link.act([number / 10])
    assert [message for *_, message in hub.machine.antenna.changes] == [(40,)]


def test_a_program_tells_zeros_in_place_of_numbers_that_are_no_commands() -> None:
    exchange = Exchange(3, (), 2)
    interface = Interface(exchange.commands[1:], ANGLES, Wait(20))
    source = generate(TWO_WHEELER, interface).source
    assert "radio = BLERadio(broadcast_channel=3, observe_channels=[])" in source
    assert "radio.broadcast([0, whole(actions[0], -100, 100, 1)])" in source


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ((0, (0,), 1), "channels 0, 0; give each robot one of its own"),
        ((0, (256,), 1), "give each robot one of its own, from 0 to 255"),
        ((0, (1,), 0), "tells 0 numbers; give 1 to 8"),
        ((0, (1,), 9), "tells 9 numbers; give 1 to 8"),
    ],
)
def test_exchanges_that_do_not_work_are_refused(
    values: tuple[int, tuple[int, ...], int], told: str
) -> None:
    with pytest.raises(DescriptionError, match=told):
        Exchange(*values)


def test_a_hub_without_bluetooth_low_energy_is_refused() -> None:
    exchange = Exchange(0, (1,), 1)
    robot = replace(
        TWO_WHEELER, hub=HubKind.EV3, motors=(), drive_base=None, sensors=(), needs_imu=False
    )
    for numbers in (exchange.commands, exchange.channels):
        with pytest.raises(DescriptionError, match="an ev3 hub tells other hubs nothing"):
            numbers[0].check(robot)
