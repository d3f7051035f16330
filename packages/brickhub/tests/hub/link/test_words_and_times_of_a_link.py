"""Words of a link's errors, and the times at which it repeats a frame."""

from __future__ import annotations

import itertools
import struct

import pytest

from brickhub.errors import HubProtocolError, SilentHubError, UnknownNameError
from brickhub.hub.link.lockstep import bye_error, check_hello
from brickhub.hub.link.profiles import PROFILES, profile, usual_link
from brickhub.hub.link.timing import percentile, repeat_times_s
from brickhub.hub.protocol import ControlFrame
from brickhub.robot import HubKind, KitKind


@pytest.mark.parametrize(
    ("move_s", "watchdog_s", "times_s"),
    [
        # Shorter than the watchdog: none to half of it, then one in the middle.
        (0.0, 0.4, [0.2, 0.4, 0.6]),
        (0.1, 0.4, [0.3, 0.5, 0.7]),
        (0.19, 0.4, [0.39, 0.59]),
        (0.21, 0.4, [0.105, 0.41, 0.61]),
        (0.39, 0.4, [0.195, 0.59, 0.79]),
        # As long, or longer: six within the watchdog's time, evenly, and none at the end.
        (0.6, 0.6, [0.6 * k / 7 for k in range(1, 7)] + [0.9, 1.2]),
        (1.0, 0.6, [k / 11 for k in range(1, 11)] + [1.3, 1.6]),
        # Nobody knows how long: six within the watchdog's time for ever.
        (None, 0.6, [0.1 * k for k in range(1, 30)]),
    ],
)
def test_times_of_repetitions(
    move_s: float | None, watchdog_s: float, times_s: list[float]
) -> None:
    found = list(itertools.islice(repeat_times_s(move_s, watchdog_s), len(times_s)))
    assert found == pytest.approx(times_s)


@pytest.mark.parametrize(
    ("values", "percent", "value"),
    [
        ([], 50, 0.0),
        ([3.0], 1, 3.0),
        ([1.0, 2.0], 50, 1.5),
        ([2.0, 1.0], 25, 1.25),
        ([1.0, 2.0], 75, 1.75),
        ([0.0, 10.0, 20.0], 99, 19.8),
    ],
)
def test_percentile_is_interpolated(values: list[float], percent: float, value: float) -> None:
    assert percentile(values, percent) == pytest.approx(value)


@pytest.mark.parametrize(
    ("reason", "why"),
    [
        (1, "it was told to"),
        (2, "it had not heard from this computer for too long"),
    ],
)
def test_words_of_a_bye(reason: int, why: str) -> None:
    error = bye_error(ControlFrame(ord("B"), bytes((reason,))))
    assert isinstance(error, SilentHubError)
    ended = f"the program on the hub ended because {why}"
    assert str(error) == f"{ended}; call open() to start it again"


def hello(version: int, program_hash: int) -> ControlFrame:
    return ControlFrame(ord("H"), struct.pack("<BI", version, program_hash))


def test_words_of_a_wrong_hello() -> None:
    check_hello(hello(1, 0xABC), 0xABC)
    speaks = "the hub speaks protocol 2, this computer 1; install one version of brickhub"
    with pytest.raises(HubProtocolError, match=f"^{speaks}$"):
        check_hello(hello(2, 0xABC), 0xABC)
    other = r"another program runs on the hub \(hash 00000abd, not 00000abc\); stop it and open"
    with pytest.raises(HubProtocolError, match=f"^{other}"):
        check_hello(hello(1, 0xABD), 0xABC)


def test_link_that_there_is_not() -> None:
    assert profile("mac") is PROFILES["mac"]
    says = r"there is no link 'linus' \(did you mean 'linux'\?\); choose mac, linux, bad-room, usb"
    with pytest.raises(UnknownNameError, match=says):
        profile("linus")


def test_usual_link_is_bluetooth_unless_there_is_only_a_cable() -> None:
    for kind in (HubKind.PRIME, HubKind.CITY, KitKind.DOUBLE_MOTOR):
        assert usual_link(kind.model) is PROFILES["linux"]
    assert usual_link(HubKind.EV3.model) is PROFILES["usb"]


def test_links_differ_as_their_names_say() -> None:
    intervals_ms = {name: link.interval_ms for name, link in PROFILES.items()}
    assert intervals_ms["mac"] == 15.0
    assert intervals_ms["linux"] == intervals_ms["bad-room"] == 45.0
    assert intervals_ms["usb-quick"] < intervals_ms["usb"] < intervals_ms["usb-slow"]
    assert PROFILES["bad-room"].loss == 10 * PROFILES["linux"].loss
    assert {PROFILES[name].loss for name in ("usb-quick", "usb", "usb-slow")} == {0.0}
    # Round trips of two looks: 5 to 20 ms.
    assert [2 * intervals_ms[name] for name in ("usb-quick", "usb-slow")] == [5.0, 20.0]
