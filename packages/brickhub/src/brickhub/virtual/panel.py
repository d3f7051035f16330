"""Panel of a hub: buttons, also those of a remote control and an Xbox controller, light, display
and loudspeaker.

Buttons are pressed by a script (``Press``, at a simulated time), or from Python and by keys while
the program runs.
"""

import base64
import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from brickhub.errors import TwinError
from brickhub.robot import AnyHub
from brickhub.robot.hardware import REMOTE_BUTTONS

DEFAULT_PRESS_S = 0.2
POLL_MS = 50
"""Poll interval of a hub's stop button (``pbio/sys/core.c``, v4)."""
_POWER_BUTTON = "center"
_SWITCH_OFF_MS = 2000
_SHADES = ".-+#"
_DIRECTIONS = ("up", "down", "left", "right")
_WIRELESS_BUTTONS = {
    "remote": REMOTE_BUTTONS,
    "infrared": ("left_up", "left_down", "right_up", "right_down", "beacon"),
    "xbox": (
        "a",
        "b",
        "x",
        "y",
        "lb",
        "rb",
        "view",
        "menu",
        "guide",
        "lj",
        "rj",
        "upload",
        "p1",
        "p2",
        "p3",
        "p4",
        *_DIRECTIONS,
        "left_trigger",
        "right_trigger",
        *(f"joystick_left_{direction}" for direction in _DIRECTIONS),
        *(f"joystick_right_{direction}" for direction in _DIRECTIONS),
    ),
}
"""Buttons of wireless devices; a stick and a trigger are pressed all the way."""
WIRELESS = frozenset(_WIRELESS_BUTTONS)
SWITCHED_OFF = "off"
"""In place of a button: a wireless device is off, or out of reach, as long as this is held."""
_MAX_S = 100_000.0
"""Latest time and longest duration of a press: more than a day."""


@dataclass(frozen=True)
class Press:
    """One press of a button.

    Attributes:
        button: ``left``, ``right``, ``center`` and so on; ``remote.left_plus`` and so on for a
            remote control, ``infrared.left_up`` and so on for that of an EV3, ``xbox.a``,
            ``xbox.joystick_left_up`` and so on for an Xbox controller. ``remote.off`` and
            ``xbox.off``: as long as that is held the device is off, or out of reach.
        start_s, duration_s: simulated seconds.

    Raises:
        TwinError: at construction, a time is out of range.
    """

    button: str
    start_s: float
    duration_s: float = DEFAULT_PRESS_S

    def __post_init__(self) -> None:
        starts_in_range = 0.0 <= self.start_s <= _MAX_S
        lasts_in_range = 0.0 < self.duration_s <= _MAX_S
        if not (starts_in_range and lasts_in_range):
            raise TwinError(
                f"the time of the press of '{self.button}' is out of range; give "
                f"{self.button}@2.5s or {self.button}@2.5s+1s"
            )


def parse_press(text: str) -> Press:
    """The press for ``left@2.5s``, or ``left@2.5s+1s`` with a duration of 1 s. Raises TwinError for
    any other text."""
    match = re.fullmatch(r"([a-z_.]+\d?)@([\d.]+)s?(?:\+([\d.]+)s?)?", text.strip().lower())
    try:
        start_s = float(match[2])  # type: ignore[index]
        duration_s = float(match[3] or DEFAULT_PRESS_S)  # type: ignore[index]
    except (TypeError, ValueError):
        raise TwinError(
            f"'{text}' is not a button press; give one such as left@2.5s, or center@4s+0.5s"
        ) from None
    return Press(match[1], start_s, duration_s)  # type: ignore[index]


class Panel:
    """Buttons, light, display and loudspeaker of a hub.

    Attributes:
        buttons: names of the hub's buttons.
        stop_buttons: buttons that stop the program when pressed together; none if empty.
        near: wireless devices that a program can connect to, of ``WIRELESS``.
        remote_name: name that a program gave to the remote control, which keeps it; ``None``
            before.
        has_display: whether the hub has a display of 5 x 5 pixels.
        light: color of the status light as (hue, saturation, value); ``None`` if off.
        display: brightness of the 25 pixels of the display in %, row by row from the top.
        text: the character or number that the display shows instead.
        screen_pixels: width and height of the hub's screen; ``None`` without one.
        screen: shades of the screen's pixels, row by row from the top, 0 (white) to 3; empty as
            long as no program has drawn on it.
        quarter_turns: clockwise turns of what a program shows, on the way to the display; of a text
            they are not seen.
        sound_hz: frequency of the loudspeaker; 0 if silent.
        lamps: brightness in % of the lights on the ports, by port, as far as a program has set
            them.
        clock_ms: simulated time, set by the panel's machine.
        is_watched: whether a person may press a button at any time.
        on_change: called with the panel after a change of light, display or sound.
        is_off: whether the center button was held so long that the hub is switched off.
        next_ms: simulated time of the next poll or animation; ``None`` for none.

    Raises:
        TwinError: the hub has no such button.
    """

    def __init__(
        self,
        hub: AnyHub,
        presses: Iterable[Press] = (),
        near: Iterable[str] = (),
    ) -> None:
        self.buttons = hub.model.buttons
        self.has_display = hub.model.has_display
        self.screen_pixels = hub.model.screen_pixels
        self._hub = hub
        self._presses: list[tuple[int, int, str]] = []
        self._held: set[str] = set()
        self.stop_buttons = frozenset({hub.model.stop_button})
        self.near = set(near)
        self.remote_name: str | None = None
        self.on_change: Callable[[Panel], None] | None = None
        self.light: tuple[int, int, int] | None = None
        self.lamps: dict[str, int] = {}
        self.sound_hz = 0
        self.display = [0] * 25
        self.text = ""
        self.screen = b""
        self.quarter_turns = 0
        self.is_watched = False
        self.is_off = False
        # Until a machine sets its own clock, this is the time of the last poll.
        self.clock_ms: Callable[[], int] = lambda: self._now_ms
        self.next_ms: int | None = None
        self._now_ms = 0
        self._stop_pressed_ms = -POLL_MS
        # These are the first and the last of the polls that found the center button down without a
        # break.
        self._center_polls = (-POLL_MS, -POLL_MS)
        self._animations: dict[str, tuple[int, Iterator[int]]] = {}
        for press in presses:
            self.press(press)

    @property
    def now_s(self) -> float:
        """Simulated time."""
        return self.clock_ms() / 1000

    def describe(self) -> str:
        """Light, display and sound in one line; the display as five rows of five, from ``.`` to
        ``#``, a screen by the number of its dark pixels."""
        light = "off"
        if self.light is not None:
            hue, saturation, value = self.light
            light = f"hue {hue}, {saturation} %, {value} %"
        # A text replaces the pixels, as on the hub.
        display = "off"
        if self.text:
            display = self.text
        elif any(self.display):
            display = self._picture()
        parts = [f"light {light}"]
        if self.screen_pixels is None:
            parts.append(f"display {display}")
        else:
            dark = len(self.screen) - self.screen.count(0)
            parts.append(f"screen {dark} dark pixels" if dark else "screen empty")
        parts.append(f"sound {self.sound_hz or 'off'}")
        for port, brightness_pct in sorted(self.lamps.items()):
            parts.append(f"lamp {port} {brightness_pct} %")
        return "; ".join(parts)

    def _picture(self) -> str:
        """The pixels of the display as text, a character each."""
        rows = []
        for start in range(0, 25, 5):
            row = ""
            for brightness_pct in self.display[start : start + 5]:
                # The darkest shade means off, so whatever shines at all gets a brighter one.
                shade = brightness_pct * 3 // 100 + (brightness_pct > 0)
                row += _SHADES[min(3, shade)]
            rows.append(row)
        return "/".join(rows)

    def packed_screen(self) -> str:
        """Shades of the screen's pixels, four to a byte, the first one in its highest bits, in
        base64; empty as long as nothing is drawn."""
        pixels = self.screen
        packed = bytearray()
        for start in range(0, len(pixels), 4):
            a, b, c, d = pixels[start : start + 4]
            packed.append((a & 3) << 6 | (b & 3) << 4 | (c & 3) << 2 | (d & 3))
        return base64.b64encode(packed).decode()

    def tap(self, button: str) -> None:
        """Press a button now, for :data:`DEFAULT_PRESS_S`."""
        # The press begins in the next millisecond, because this one may have been polled already.
        self.press(Press(button, self.now_s + 0.001))

    def press(self, press: Press) -> None:
        """Schedule a press."""
        self._check(press.button)
        # A wireless device whose button is pressed must be there.
        device = press.button.partition(".")[0]
        self.near |= {device} & WIRELESS
        start_ms = round(press.start_s * 1000)
        duration_ms = max(1, math.ceil(press.duration_s * 1000))
        self._presses.append((start_ms, start_ms + duration_ms, press.button))
        self._schedule(self.clock_ms())

    def hold(self, button: str) -> None:
        """Press a button now, until :meth:`release`."""
        self._check(button)
        self._held.add(button)
        self._schedule(self.clock_ms())

    def release(self, button: str) -> None:
        self._held.discard(button)

    @property
    def is_unattended(self) -> bool:
        """Whether no button will ever be pressed again."""
        if self.is_watched or self._held:
            return False
        now_ms = self.clock_ms()
        return not any(end_ms > now_ms for _, end_ms, _ in self._presses)

    def pressed(self, time_ms: int) -> frozenset[str]:
        """Buttons of the hub that are down at a simulated time."""
        # Buttons of other devices have the device before a dot.
        return frozenset(name for name in self._down(time_ms) if "." not in name)

    def pressed_on(
        self,
        device: str,
        time_ms: int,
    ) -> frozenset[str]:
        """Buttons of a wireless device that are down at a simulated time."""
        prefix = f"{device}."
        names = set()
        for name in self._down(time_ms):
            if name.startswith(prefix):
                names.add(name.removeprefix(prefix))
        return frozenset(names)

    def was_off(
        self,
        device: str,
        start_ms: int,
        end_ms: int,
    ) -> bool:
        """Whether a wireless device was off, or out of reach, at any time from ``start_ms`` to
        ``end_ms``."""
        name = f"{device}.{SWITCHED_OFF}"
        is_held = name in self._held
        spans = [(first, last) for first, last, button in self._presses if button == name]
        return is_held or any(first <= end_ms and last > start_ms for first, last in spans)

    def poll(self, time_ms: int) -> bool:
        """Process animations and the poll that are due; returns whether a program ends, as the stop
        button was pressed since the last poll, or the hub is switched off."""
        self._now_ms = time_ms
        # This iterates over a copy, because a step of an animation may change the panel. An
        # interval of 0 takes a millisecond here, because time would otherwise never pass.
        for part, (due_ms, frames) in tuple(self._animations.items()):
            if due_ms <= time_ms:
                self._animations[part] = time_ms + max(1, next(frames)), frames
        self._schedule(time_ms + 1)
        # This poll belongs to the millisecond before, in which the program has not resumed yet.
        if time_ms % POLL_MS:
            return False
        down = self.pressed(time_ms - 1)
        # After two seconds the center button switches the hub off, whatever the program made of the
        # stop button.
        if _POWER_BUTTON in down:
            first_ms, last_ms = self._center_polls
            is_held_since = last_ms == time_ms - POLL_MS
            first_ms = first_ms if is_held_since else time_ms
            self._center_polls = first_ms, time_ms
            self.is_off = time_ms - first_ms >= _SWITCH_OFF_MS
            if self.is_off:
                return True
        # All stop buttons must be down at once. Held on, they stop only one program, because the
        # next one may start under the finger.
        if not self.stop_buttons or not self.stop_buttons <= down:
            return False
        was_pressed = self._stop_pressed_ms == time_ms - POLL_MS
        self._stop_pressed_ms = time_ms
        return not was_pressed

    def animate(
        self,
        part: str,
        frames: Iterator[int],
    ) -> None:
        """Animate the light or the display (``part``), in place of its last animation.

        Args:
            frames: endless; each step shows the next picture and gives its duration in ms.
        """
        # This shows the first picture at once, and the next one is due after its duration.
        duration_ms = max(1, next(frames))
        due_ms = self.clock_ms() + 1 + duration_ms
        self._animations[part] = due_ms, frames
        self._schedule(self.clock_ms() + 1)

    def stop_animation(self, part: str) -> bool:
        """Keep the current picture; returns whether there was an animation."""
        return self._animations.pop(part, None) is not None

    def start_program(self) -> None:
        """Reset as before each program: default stop button, no light, sound or display."""
        self.stop_buttons = frozenset({self._hub.model.stop_button})
        self.quarter_turns = 0
        self._animations.clear()
        self.change(light=None)
        self.change(sound_hz=0, lamps={}, screen=b"")
        self.show([0] * 25)

    def show(
        self,
        pixels: list[int],
        text: str = "",
    ) -> None:
        """Show pixels (brightness in %, 25 values) or a text."""
        self.change(display=pixels, text=text)

    def change(self, **outputs: Any) -> None:
        """Change light, display, text, screen or sound."""
        # Watchers are told of real changes only, because a program may show the same all the time.
        if any(getattr(self, name) != value for name, value in outputs.items()):
            vars(self).update(outputs)
            if self.on_change is not None:
                self.on_change(self)

    def _down(self, time_ms: int) -> set[str]:
        down = set(self._held)
        for start_ms, end_ms, name in self._presses:
            if start_ms <= time_ms < end_ms:
                down.add(name)
        return down

    def _schedule(self, from_ms: int) -> None:
        """Compute :attr:`next_ms`: the next poll of a pressed button or step of an animation."""
        # A button is down within these times; the poll of a millisecond is in the next one.
        spans = []
        for start_ms, end_ms, _ in self._presses:
            if end_ms >= from_ms:
                spans.append((max(start_ms + 1, from_ms), end_ms))
        if self._held:
            spans.append((from_ms, from_ms + POLL_MS))
        due = [due_ms for due_ms, _ in self._animations.values()]
        for begin_ms, end_ms in spans:
            # The end is rounded up to the next poll, because a short press may fall between two of
            # them.
            poll_ms = -(-begin_ms // POLL_MS) * POLL_MS
            if poll_ms <= end_ms:
                due.append(poll_ms)
        self.next_ms = min(due, default=None)

    def _check(self, button: str) -> None:
        device = button.partition(".")[0]
        buttons = _WIRELESS_BUTTONS.get(device, ())
        names = (*buttons, SWITCHED_OFF) if buttons else ()
        wireless_names = [f"{device}.{name}" for name in names]
        if button in (wireless_names or self.buttons):
            return
        if wireless_names:
            owner = f"the {device}"
            known = wireless_names
        else:
            owner = f"the {self._hub.value} hub"
            also = "or of a wireless device, such as remote.left_plus or xbox.a"
            known = [*self.buttons, also]
        raise TwinError(f"{owner} has no button '{button}'; press one of {', '.join(known)}")
