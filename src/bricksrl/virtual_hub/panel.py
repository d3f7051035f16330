"""The outside of a hub: its buttons, its light, its display and its loudspeaker, and those of a remote control.

Buttons are pressed by a script (``Press``, at a simulated time), or from Python and by keys while the program runs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from bricksrl.errors import TwinError
from bricksrl.robots import HubKind

DEFAULT_PRESS_S = 0.2
POLL_MS = 50
"""How often a hub looks at its stop button (``pbio/sys/core.c``, v4)."""
STOP_BUTTON = "center"
_SHADES = ".-+#"
_REMOTE = "remote."
_REMOTE_BUTTONS = ("left_plus", "left", "left_minus", "right_plus", "right", "right_minus", "center")
_LOW, _HIGH = 0.0, 100_000.0


@dataclass(frozen=True)
class Press:
    """One press of a button.

    Attributes:
        button: ``left``, ``right``, ``center``, ``bluetooth``; ``remote.left_plus`` and so on for a remote control.
        start_s, duration_s: simulated seconds.

    Raises:
        TwinError: at construction, when the times are none.
    """

    button: str
    start_s: float
    duration_s: float = DEFAULT_PRESS_S

    def __post_init__(self) -> None:
        if not (_LOW <= self.start_s <= _HIGH and 0.0 < self.duration_s <= _HIGH):
            raise TwinError(
                f"the press of '{self.button}' has no time; give one such as {self.button}@2.5s or {self.button}@2.5s+1s"
            )


def parse_press(text: str) -> Press:
    """``left@2.5s``, or ``left@2.5s+1s`` for one that lasts a second.

    Raises:
        TwinError: it is something else.
    """
    match = re.fullmatch(r"([a-z_.]+)@([\d.]+)s?(?:\+([\d.]+)s?)?", text.strip().lower())
    try:
        start_s, duration_s = float(match[2]), float(match[3] or DEFAULT_PRESS_S)  # type: ignore[index]
    except (TypeError, ValueError):
        raise TwinError(f"'{text}' is no press of a button; give one such as left@2.5s, or center@4s+0.5s") from None
    return Press(match[1], start_s, duration_s)  # type: ignore[index]


class Panel:
    """What a person can press, see and hear.

    Attributes:
        buttons: those that the hub has.
        stop_buttons: pressed together they stop the program; none of them does where it is empty.
        has_remote: whether a remote control is near that a program can connect to.
        light: color of the status light as (hue, saturation, value); ``None`` while it is off.
        display: brightness of the 25 pixels of the display in %, row by row from the top, as the program gave them.
        text: the character or number that the display shows instead.
        sound_hz: what the loudspeaker plays; 0 for nothing.
        clock_ms: simulated time; the machine that the panel belongs to sets it.
        is_watched: whether somebody sits before it who may press a button at any time.
        on_change: called with the panel when something else can be seen or heard.
        next_ms: simulated time of the next thing that happens here by itself; ``None`` for nothing.

    Raises:
        TwinError: the hub has no such button.
    """

    def __init__(self, hub: HubKind, presses: Iterable[Press] = (), has_remote: bool = False) -> None:
        self.buttons = (STOP_BUTTON, "left", "right", "bluetooth") if hub is HubKind.PRIME else (STOP_BUTTON,)
        self._hub = hub
        self._presses: list[tuple[int, int, str]] = []
        self._held: set[str] = set()
        self.stop_buttons = frozenset({STOP_BUTTON})
        self.has_remote = has_remote
        self.on_change: Callable[[Panel], None] | None = None
        self._light: tuple[int, int, int] | None = None
        self._sound_hz = 0
        self.display = [0] * 25
        self.text = ""
        self.is_watched = False
        self.clock_ms: Callable[[], int] = lambda: self._now_ms
        self.next_ms: int | None = None
        self._now_ms = 0
        self._stop_pressed_ms = -POLL_MS
        self._animations: dict[str, tuple[int, Iterator[int]]] = {}
        for press in presses:
            self.press(press)

    @property
    def light(self) -> tuple[int, int, int] | None:
        return self._light

    @light.setter
    def light(self, color: tuple[int, int, int] | None) -> None:
        if color != self._light:
            self._light = color
            self._changed()

    @property
    def sound_hz(self) -> int:
        return self._sound_hz

    @sound_hz.setter
    def sound_hz(self, frequency: int) -> None:
        if frequency != self._sound_hz:
            self._sound_hz = frequency
            self._changed()

    @property
    def now_s(self) -> float:
        """Simulated time, as far as the panel knows it."""
        return self.clock_ms() / 1000

    def describe(self) -> str:
        """One line of what can be seen and heard; the display as five rows of five, from ``.`` to ``#``."""
        light = "off" if self._light is None else f"hue {self._light[0]}, {self._light[1]} %, {self._light[2]} %"
        rows = (self.display[i : i + 5] for i in range(0, 25, 5))
        display = self.text or "/".join("".join(_SHADES[min(3, value * 3 // 100 + (value > 0))] for value in row) for row in rows)
        return f"light {light}; display {display if any(self.display) or self.text else 'off'}; sound {self._sound_hz or 'off'}"

    def tap(self, button: str) -> None:
        """Press a button now, for a moment."""
        self.press(Press(button, self.clock_ms() / 1000 + 0.001))

    def press(self, press: Press) -> None:
        """Let a button be pressed at a simulated time."""
        self._check(press.button)
        self.has_remote = self.has_remote or press.button.startswith(_REMOTE)
        start_ms = round(press.start_s * 1000)
        self._presses.append((start_ms, start_ms + max(1, math.ceil(press.duration_s * 1000)), press.button))
        self._schedule(self.clock_ms())

    def hold(self, button: str) -> None:
        """Press a button now, until :meth:`release`."""
        self._check(button)
        self._held.add(button)
        self._schedule(self.clock_ms())

    def release(self, button: str) -> None:
        self._held.discard(button)

    @property
    def is_deserted(self) -> bool:
        """Whether no button will ever be pressed again."""
        now_ms = self.clock_ms()
        return not (self.is_watched or self._held or any(end_ms > now_ms for _, end_ms, _ in self._presses))

    def pressed(self, time_ms: int) -> frozenset[str]:
        """The hub's own buttons that are down at a simulated time."""
        return frozenset(name for name in self._down(time_ms) if not name.startswith(_REMOTE))

    def pressed_on_remote(self, time_ms: int) -> frozenset[str]:
        """The buttons of the remote control that are down."""
        return frozenset(name.removeprefix(_REMOTE) for name in self._down(time_ms) if name.startswith(_REMOTE))

    def stops(self, time_ms: int) -> bool:
        """Do what is due, and say whether the stop button was pressed since the last look at it."""
        self._now_ms = time_ms
        for part, (due_ms, frames) in tuple(self._animations.items()):
            if due_ms <= time_ms:
                self._animations[part] = time_ms + max(1, next(frames)), frames
        self._schedule(time_ms + 1)
        # The look belongs to the millisecond that the program has not begun yet.
        if time_ms % POLL_MS or not self.stop_buttons or not self.stop_buttons <= self.pressed(time_ms - 1):
            return False
        was_pressed = self._stop_pressed_ms == time_ms - POLL_MS
        self._stop_pressed_ms = time_ms
        return not was_pressed

    def animate(self, part: str, frames: Iterator[int]) -> None:
        """Let the light or the display (``part``) change by itself, in place of what it did before.

        Args:
            frames: shows the next picture and says for how many milliseconds, for ever.
        """
        self._animations[part] = self.clock_ms() + 1 + max(1, next(frames)), frames
        self._schedule(self.clock_ms() + 1)

    def stop_animation(self, part: str) -> bool:
        """Keep the picture of this moment; whether there was an animation."""
        return self._animations.pop(part, None) is not None

    def start_program(self) -> None:
        """What a hub does before a program: the stop button stops, the display is dark."""
        self.stop_buttons = frozenset({STOP_BUTTON})
        self._animations.clear()
        self.light, self.sound_hz = None, 0
        self.show([0] * 25)

    def show(self, pixels: list[int], text: str = "") -> None:
        """Put something else on the display."""
        if (pixels, text) != (self.display, self.text):
            self.display, self.text = pixels, text
            self._changed()

    def _changed(self) -> None:
        if self.on_change is not None:
            self.on_change(self)

    def _down(self, time_ms: int) -> set[str]:
        return self._held | {name for start_ms, end_ms, name in self._presses if start_ms <= time_ms < end_ms}

    def _schedule(self, from_ms: int) -> None:
        """Find out when the stop button is to be looked at again, or an animation goes on."""
        polls = [(max(start_ms + 1, from_ms), end_ms) for start_ms, end_ms, _ in self._presses if end_ms >= from_ms]
        polls += [(from_ms, from_ms + POLL_MS)] * bool(self._held)
        due = [poll_ms for begin_ms, end_ms in polls if (poll_ms := -(-begin_ms // POLL_MS) * POLL_MS) <= end_ms]
        self.next_ms = min((*due, *(due_ms for due_ms, _ in self._animations.values())), default=None)

    def _check(self, button: str) -> None:
        known = (*self.buttons, *(_REMOTE + name for name in _REMOTE_BUTTONS))
        if button not in known:
            raise TwinError(f"a {self._hub.value} hub has no button '{button}'; press one of {', '.join(known)}")
