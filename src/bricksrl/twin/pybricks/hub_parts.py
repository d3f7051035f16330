"""What a hub object holds besides the IMU: lights, display, speaker, buttons, battery, system, radio."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from bricksrl.twin.machine import Machine
from bricksrl.twin.micropython.containers import HubDict, HubSet
from bricksrl.twin.pybricks.context import Context, charged, expect_type, get_int
from bricksrl.twin.pybricks.matrix import Matrix
from bricksrl.twin.pybricks.parameters import Color, Side

_STORAGE_BYTES = 512
_IDLE_CURRENT_MA = 100


class _Part:
    def __init__(self, context: Context) -> None:
        self._machine: Machine = context.machine
        self._loop = context.loop


class ColorLight(_Part):
    """The status light. Nobody sees it; values are checked."""

    @charged
    def on(self, color: Any) -> None:
        expect_type(color, Color)

    @charged
    def off(self) -> None:
        pass

    @charged
    def blink(self, color: Any, durations: Any) -> None:
        expect_type(color, Color)
        for duration in durations:
            get_int(duration)

    @charged
    def animate(self, colors: Any, interval: Any) -> None:
        for color in colors:
            expect_type(color, Color)
        get_int(interval)


class LightMatrix(_Part):
    """The display. Nobody sees it; values are checked, and text takes its time."""

    @charged
    def orientation(self, up: Any) -> None:
        expect_type(up, Side)
        if up not in (Side.TOP, Side.LEFT, Side.RIGHT, Side.BOTTOM):
            raise ValueError("Invalid argument")

    @charged
    def icon(self, icon: Any) -> None:
        Matrix(icon)

    @charged
    def animate(self, matrices: Any, interval: Any) -> None:
        for matrix in matrices:
            Matrix(matrix)
        get_int(interval)

    @charged
    def pixel(self, row: Any, column: Any, brightness: Any = 100) -> None:
        for value in (row, column, brightness):
            get_int(value)

    @charged
    def off(self) -> None:
        pass

    @charged
    def number(self, number: Any) -> None:
        get_int(number)

    @charged
    def char(self, char: Any) -> None:
        expect_type(char, str)
        if len(char) != 1 or not 32 <= ord(char) <= 126:
            raise ValueError("Invalid argument")

    @charged
    def text(self, text: Any, on: Any = 500, off: Any = 50) -> Any:
        expect_type(text, str)
        if any(not 32 <= ord(c) <= 126 for c in text):
            raise ValueError("Invalid argument")
        duration = len(text) * (max(0, get_int(on)) + max(0, get_int(off)))
        return self._loop.wait_until(self._machine.time_ms + duration)


_NOTE = re.compile(r"(?:(R)|([A-G][#b]?)([2-8]))/(\d{1,2})(\.?)(_?)")


class Speaker(_Part):
    """The loudspeaker. Nobody hears it; sounds take their time."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._volume = 100

    @charged
    def volume(self, volume: Any = None) -> int | None:
        if volume is None:
            return self._volume
        self._volume = max(0, min(100, get_int(volume)))
        return None

    @charged
    def beep(self, frequency: Any = 500, duration: Any = 100) -> Any:
        get_int(frequency)
        return self._loop.wait_until(self._machine.time_ms + max(0, get_int(duration)))

    @charged
    def play_notes(self, notes: Any, tempo: Any = 120) -> Any:
        bar_ms = 4 * 60 * 1000 // get_int(tempo)
        waiting = iter(self._notes(iter(notes), bar_ms))
        return self._loop.finish(lambda: next(waiting, True), grain_ms=1)

    def _notes(self, notes: Iterator[Any], bar_ms: int) -> Iterator[bool]:
        """False as long as a note sounds."""
        for note in notes:
            end_ms = self._machine.time_ms + _note_ms(note, bar_ms)
            while self._machine.time_ms < end_ms:
                yield False


def _note_ms(note: Any, bar_ms: int) -> int:
    expect_type(note, str)
    match = _NOTE.match(note)
    if match is None or match[2] in ("Cb", "B#", "E#", "Fb") or int(match[4]) == 0:
        raise ValueError("Missing note name A-G or R" if match is None else f"{match[2]} is not allowed")
    duration = bar_ms // int(match[4])
    return 3 * duration // 2 if match[5] else duration


class Keypad(_Part):
    """The buttons of the hub: nobody presses them."""

    @charged
    def pressed(self) -> set[Any]:
        return HubSet()


class Battery(_Part):
    @charged
    def voltage(self) -> int:
        return self._machine.body.battery_mv

    @charged
    def current(self) -> int:
        return _IDLE_CURRENT_MA


class Charger(_Part):
    """No charger is connected."""

    @charged
    def connected(self) -> bool:
        return False

    @charged
    def status(self) -> int:
        return 0

    @charged
    def current(self) -> int:
        return 0


class System(_Part):
    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._storage = bytearray(_STORAGE_BYTES)

    @charged
    def set_stop_button(self, button: Any) -> None:
        pass

    @charged
    def name(self) -> str:
        return "Pybricks Hub"

    @charged
    def reset_reason(self) -> int:
        return 0

    @charged
    def info(self) -> dict[str, Any]:
        found = {
            "name": self.name(),
            "reset_reason": 0,
            "host_connected_ble": True,
            "host_connected_usb": False,
            "program_start_type": 3,
            "program_id": 0,
        }
        return HubDict.sized(len(found), found.items())

    def shutdown(self) -> None:
        raise SystemExit

    @charged
    def storage(self, offset: Any, read: Any = None, write: Any = None) -> bytes | None:
        start = get_int(offset)
        if (read is None) == (write is None):
            raise ValueError("Invalid argument")
        if write is not None and not isinstance(write, bytes | bytearray):
            raise TypeError("expected write (bytes).")
        size = get_int(read) if write is None else len(write)
        if start < 0 or size < 0 or start + size > _STORAGE_BYTES:
            raise ValueError("Invalid argument")
        if write is None:
            return bytes(self._storage[start : start + size])
        self._storage[start : start + size] = write
        return None

    @charged
    def reset_storage(self) -> None:
        self._storage[:] = bytes(_STORAGE_BYTES)
