"""The panel of a hub by itself: presses, what is shown, and who is told."""

from __future__ import annotations

import base64
import random

import pytest

from brickhub.errors import TwinError
from brickhub.robot import HubKind
from brickhub.virtual.panel import DEFAULT_PRESS_S, Panel, Press, parse_press


def at(panel: Panel, time_ms: int) -> None:
    panel.clock_ms = lambda: time_ms


@pytest.mark.parametrize("count", [0, 1, 3, 4, 10, 178 * 128])
def test_a_packed_screen_has_four_pixels_a_byte(count: int) -> None:
    panel = Panel(HubKind.EV3)
    # What is drawn is a whole number of bytes; what is left of the last one would be white.
    pixels = bytes(random.Random(count).randrange(4) for _ in range(4 * count))
    panel.screen = pixels
    unpacked = bytearray()
    for byte in base64.b64decode(panel.packed_screen()):
        unpacked += bytes(byte >> shift & 3 for shift in (6, 4, 2, 0))
    assert bytes(unpacked) == pixels


def test_a_tap_begins_in_the_next_millisecond() -> None:
    panel = Panel(HubKind.PRIME)
    at(panel, 1000)
    panel.tap("left")
    last_ms = 1000 + round(1000 * DEFAULT_PRESS_S)
    assert [panel.pressed(ms) for ms in (1000, 1001, last_ms, last_ms + 1)] == [
        frozenset(),
        {"left"},
        {"left"},
        frozenset(),
    ]


def test_a_short_press_is_down_for_a_millisecond() -> None:
    panel = Panel(HubKind.PRIME, [Press("left", 0.5, 0.0001)])
    assert [ms for ms in range(490, 510) if panel.pressed(ms)] == [500]


def test_who_is_there_may_press_again() -> None:
    panel = Panel(HubKind.PRIME, [parse_press("right@1s+0.5s")])
    assert not panel.is_unattended
    at(panel, 1499)
    assert not panel.is_unattended
    at(panel, 1500)
    assert panel.is_unattended
    panel.hold("left")
    assert not panel.is_unattended and panel.pressed(9999) == {"left"}
    panel.release("left")
    panel.release("left")
    assert panel.is_unattended and not panel.pressed(9999)
    panel.is_watched = True
    assert not panel.is_unattended


def test_a_wireless_device_is_near_and_has_buttons_of_its_own() -> None:
    panel = Panel(HubKind.PRIME, [Press("remote.left_plus", 1.0, 1.0), Press("left", 1.0, 1.0)])
    assert panel.near == {"remote"}
    assert panel.pressed(1500) == {"left"}
    assert panel.pressed_on("remote", 1500) == {"left_plus"}
    assert not panel.pressed_on("xbox", 1500)


def test_a_device_that_was_off_at_any_time_of_a_span() -> None:
    panel = Panel(HubKind.PRIME, [Press("remote.off", 1.0, 1.0)])
    spans = [(0, 999), (0, 1000), (1200, 1300), (1999, 5000), (2000, 5000)]
    assert [panel.was_off("remote", *span) for span in spans] == [False, True, True, True, False]
    assert not panel.was_off("xbox", 0, 5000)
    panel.hold("xbox.off")
    assert panel.was_off("xbox", 7000, 7000)


@pytest.mark.parametrize(
    ("text", "press"),
    [
        ("left@2.5s", Press("left", 2.5)),
        (" LEFT@2.5 ", Press("left", 2.5)),
        ("center@4s+0.5s", Press("center", 4.0, 0.5)),
        ("xbox.joystick_left_up@0+1", Press("xbox.joystick_left_up", 0.0, 1.0)),
    ],
)
def test_texts_of_presses(text: str, press: Press) -> None:
    assert parse_press(text) == press


@pytest.mark.parametrize(
    "text", ["left", "left@", "left@x", "left@1s+", "left@1.2.3", "@1s", "left@-1"]
)
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(TwinError, match=r"is not a button press; give one such as left@2\.5s"):
        parse_press(text)


@pytest.mark.parametrize(
    ("start_s", "duration_s", "fits"),
    [(0.0, 0.001, True), (-0.001, 1.0, False), (0.0, 0.0, False), (float("nan"), 1.0, False)],
)
def test_times_of_presses(start_s: float, duration_s: float, fits: bool) -> None:
    if fits:
        Press("left", start_s, duration_s)
        return
    with pytest.raises(TwinError, match="the time of the press of 'left' is out of range"):
        Press("left", start_s, duration_s)


@pytest.mark.parametrize(
    ("hub", "button", "said"),
    [
        (
            HubKind.PRIME,
            "middle",
            "the prime hub has no button 'middle'; press one of center, left",
        ),
        (HubKind.CITY, "left", "the city hub has no button 'left'; press one of center"),
        (HubKind.PRIME, "remote.x", "the remote has no button 'remote.x'; press one of remote"),
        (HubKind.PRIME, "phone.x", "the prime hub has no button 'phone.x'"),
    ],
)
def test_buttons_that_are_not_there(hub: HubKind, button: str, said: str) -> None:
    for use in (lambda: Panel(hub).hold(button), lambda: Panel(hub, [Press(button, 1.0)])):
        with pytest.raises(TwinError, match=said):
            use()


def test_a_program_begins_with_nothing_on_and_watchers_hear_of_changes_only() -> None:
    panel = Panel(HubKind.PRIME)
    told: list[str] = []
    panel.on_change = lambda changed: told.append(changed.describe())
    panel.change(light=(120, 100, 50), sound_hz=440, lamps={"B": 30, "A": 100})
    panel.show([100, 50, 1, 0, 34] + 20 * [0])
    panel.show([100, 50, 1, 0, 34] + 20 * [0])
    panel.change(sound_hz=440)
    lamps = "sound 440; lamp A 100 %; lamp B 30 %"
    assert told == [
        f"light hue 120, 100 %, 50 %; display off; {lamps}",
        f"light hue 120, 100 %, 50 %; display #+-.+/...../...../...../.....; {lamps}",
    ]
    panel.show([0] * 25, text="7")
    assert "display 7;" in panel.describe()
    panel.stop_buttons, panel.quarter_turns, panel.screen = frozenset(), 3, b"\1"
    panel.animate("light", iter([10, 10, 10]))
    panel.start_program()
    assert panel.describe() == "light off; display off; sound off"
    assert (panel.stop_buttons, panel.quarter_turns, panel.screen) == ({"center"}, 0, b"")
    assert not panel.stop_animation("light")


def test_a_screen_is_described_by_its_dark_pixels() -> None:
    panel = Panel(HubKind.EV3)
    assert panel.describe() == "light off; screen empty; sound off"
    panel.change(screen=bytes([0, 3, 2, 0, 1]))
    assert panel.describe() == "light off; screen 3 dark pixels; sound off"
    panel.start_program()
    assert panel.describe() == "light off; screen empty; sound off"


def test_animations_go_on_by_themselves_and_a_step_takes_a_millisecond_at_least() -> None:
    panel = Panel(HubKind.PRIME)
    frames = iter([0, 5, 100, 100])
    seen = []

    def shown():
        for duration_ms in frames:
            seen.append((panel.clock_ms(), duration_ms))
            yield duration_ms

    panel.animate("display", shown())
    for time_ms in range(1, 20):
        at(panel, time_ms)
        panel.poll(time_ms)
    assert seen == [(0, 0), (2, 5), (7, 100)]
    assert panel.next_ms == 107
    assert panel.stop_animation("display") and not panel.stop_animation("display")
