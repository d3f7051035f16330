"""The air between hubs: what is heard when, how strong, and for how long."""

from __future__ import annotations

import math

import pytest

from brickhub.virtual.air import Air, Antenna, Heard

FAR_FUTURE_MS = 100_000


def sender_and_listeners(count: int, channel: int = 1) -> tuple[Antenna, list[Antenna]]:
    sender = Antenna()
    listeners = [Antenna() for _ in range(count)]
    for listener in listeners:
        listener.observe([channel])
    return sender, listeners


class Counted(Heard):
    """A channel that notes each message."""

    def __init__(self) -> None:
        super().__init__()
        self.taken: list[tuple[int, object, int]] = []

    def take(self, time_ms: int, message: object, strength_dbm: int) -> None:
        self.taken.append((time_ms, message, strength_dbm))


def heard(
    changes: list[tuple[int, int, object]],
    until_ms: int = FAR_FUTURE_MS,
    *,
    distance_m: float = 1.0,
    step_ms: int = 5,
    seed: int = 0,
) -> list[tuple[int, object, int]]:
    """What one hub hears of another one on channel 1: time, message and strength."""
    sender, (listener,) = sender_and_listeners(1)
    air = Air([sender, listener], lambda _one, _other: distance_m, seed)
    noted = Counted()
    listener.heard[1] = noted
    for time_ms in range(0, until_ms + 1, step_ms):
        for at_ms, channel, message in changes:
            if time_ms - step_ms < at_ms <= time_ms:
                sender.broadcast(at_ms, channel, message)  # type: ignore[arg-type]
        air.carry(time_ms)
    return noted.taken


def test_the_first_message_sets_the_strength_and_later_ones_are_smoothed() -> None:
    """Over 512 ms: after a quarter of that, a quarter of the difference."""
    one = Heard()
    one.take(5000, "a", -60)
    assert (one.time_ms, one.message, one.strength_dbm) == (5000, "a", -60)
    one.take(5128, "b", -100)
    assert (one.message, one.strength_dbm) == ("b", -70)
    one.take(5640, "c", -40)
    assert one.strength_dbm == -40, "after 512 ms nothing is left of the former ones"
    one.take(5640, "d", -99)
    assert one.strength_dbm == -40, "no time has passed"
    one.take(5641, "e", -41)
    assert one.strength_dbm == -41, "rounded down"


def test_a_message_counts_for_a_second() -> None:
    antenna = Antenna()
    antenna.observe([3, 7])
    antenna.heard[3].take(2000, "on", -50)
    assert antenna.observed(2000, 3) == ("on", -50)
    assert antenna.observed(3000, 3) == ("on", -50)
    assert antenna.observed(3001, 3) == (None, -128)
    assert antenna.observed(0, 7) == (None, -128), "nothing was heard before the first message"
    antenna.observe([7])
    assert list(antenna.heard) == [7]


@pytest.mark.parametrize(
    ("distance_m", "strength_dbm"),
    [(1.0, -55), (2.0, -61), (0.5, -49), (10.0, -75), (0.05, -29), (0.01, -29), (0.0, -29)],
)
def test_strength_falls_by_6_db_at_twice_the_distance(distance_m: float, strength_dbm: int) -> None:
    """From -55 dBm at a metre; nearer than 5 cm nothing changes."""
    taken = heard([(0, 1, "a")], 3000, distance_m=distance_m)
    assert {strength for _, _, strength in taken} == {strength_dbm}


def test_advertisements_come_every_100_to_110_milliseconds_and_one_in_twenty_is_lost() -> None:
    taken = heard([(0, 1, "a")])
    times_ms = [time_ms for time_ms, _, _ in taken]
    assert 0 <= times_ms[0] <= 10
    gaps_ms = [after - before for before, after in zip(times_ms, times_ms[1:], strict=False)]
    assert min(gaps_ms) >= 99
    single = [gap for gap in gaps_ms if gap <= 111]
    assert max(single) >= 108 and min(single) <= 102
    # A lost one leaves a gap of two intervals.
    expected = FAR_FUTURE_MS / 105
    assert len(taken) == pytest.approx(0.95 * expected, rel=0.03)


def test_what_is_advertised_is_heard_at_its_time_whatever_the_steps() -> None:
    changes: list[tuple[int, int, object]] = [(0, 1, "a"), (500, 1, "b"), (1000, 1, None)]
    by_steps = [heard(changes, 2000, step_ms=step_ms) for step_ms in (1, 5, 100)]
    assert by_steps[0] == by_steps[1] == by_steps[2]
    messages = [message for _, message, _ in by_steps[0]]
    assert set(messages) == {"a", "b"} and messages == sorted(messages)
    assert all(isinstance(time_ms, int) for time_ms, _, _ in by_steps[0])


def test_of_several_changes_the_last_one_before_an_advertisement_counts() -> None:
    changes: list[tuple[int, int, object]] = [(10, 1, "a"), (200, 1, "b"), (201, 1, "c")]
    messages = [message for _, message, _ in heard(changes, 1500)]
    assert "b" not in messages and messages[0] == "a" and messages[-1] == "c"


def test_nothing_is_heard_of_other_channels_or_after_the_end() -> None:
    assert heard([(0, 2, "a")], 2000) == []
    taken = heard([(0, 1, "a"), (1000, 1, None)], 3000)
    assert taken and all(time_ms <= 1110 for time_ms, _, _ in taken)
    # Who begins again does so with a delay of its own.
    again = heard([(0, 1, "a"), (1000, 1, None), (2000, 1, "b")], 2200)
    assert min(time_ms for time_ms, message, _ in again if message == "b") >= 2000


def test_no_hub_hears_itself_and_each_other_one_hears_it() -> None:
    sender, listeners = sender_and_listeners(2)
    sender.observe([1])
    Air([sender, *listeners], lambda *_: 1.0).carry(0)
    air = Air([sender, *listeners], lambda *_: 1.0)
    sender.broadcast(0, 1, "a")
    for time_ms in range(0, 1000, 5):
        air.carry(time_ms)
    assert sender.observed(1000, 1) == (None, -128)
    assert [listener.observed(1000, 1)[0] for listener in listeners] == ["a", "a"]


def test_distances_are_those_of_the_two_hubs() -> None:
    sender, listeners = sender_and_listeners(2)
    places_m = [0.0, 1.0, 4.0]
    air = Air([sender, *listeners], lambda one, other: abs(places_m[one] - places_m[other]))
    sender.broadcast(0, 1, "a")
    for time_ms in range(0, 600, 5):
        air.carry(time_ms)
    near, far = (listener.observed(600, 1)[1] for listener in listeners)
    assert near == pytest.approx(-55, abs=1)
    assert far == pytest.approx(-55 - 20 * math.log10(4), abs=1)


def test_the_seed_gives_the_delays() -> None:
    one, same, other = (heard([(0, 1, "a")], 3000, seed=seed) for seed in (3, 3, 4))
    assert one == same != other


def test_alone_a_hub_keeps_its_last_change_only() -> None:
    alone = Antenna()
    alone.broadcast(10, 1, "a")
    alone.broadcast(20, 2, "b")
    assert alone.changes == [(20, 2, "b")]
    assert alone.current == (2, "b")
    alone.broadcast(30, 2, None)
    assert (alone.changes, alone.current) == ([(30, 2, None)], None)
    Air([alone], lambda *_: 1.0)
    alone.broadcast(40, 1, "c")
    alone.broadcast(50, 1, "d")
    assert len(alone.changes) == 3, "others could hear all of them"
    alone.observe([5])
    alone.fall_silent(60)
    assert (alone.heard, alone.current, alone.changes[-1]) == ({}, None, (60, 0, None))
