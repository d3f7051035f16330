"""Parts of a hub object besides the IMU: lights, display, speaker, buttons, battery, system, radio."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Any

from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.containers import HubDict
from brickhub.virtual.micropython.exceptions import SwitchedOff
from brickhub.virtual.micropython.numbers import expect_int
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.pybricks.context import Awaited, Context, charged, expect_type, get_array, get_int, get_text, percentage
from brickhub.virtual.pybricks.matrix import Matrix
from brickhub.virtual.pybricks.parameters import Button, Color, Side, buttons

_STORAGE_BYTES = 512
_IDLE_CURRENT_MA = 100
_ROOM_TEMPERATURE_MDEG = 25_000


class _Part:
    def __init__(self, context: Context) -> None:
        self._machine: Machine = context.machine
        self._loop = context.loop
        self._panel = context.machine.panel


class ColorLight(_Part):
    """Status light."""

    @charged
    def on(self, color: Any) -> None:
        self._show(color)

    @charged
    def off(self) -> None:
        self._panel.stop_animation("light")
        self._set_light(None, 0)

    @charged
    def blink(self, color: Any, durations: Any) -> None:
        durations_ms = [get_int(duration) for _, duration in zip(range(len(durations)), durations, strict=False)]
        if any(duration <= 0 for duration in durations_ms):
            raise ValueError("Invalid argument")
        self._show(color)
        self._play([(None if index % 2 else color, duration) for index, duration in enumerate(durations_ms)])

    @charged
    def animate(self, colors: Any, interval: Any) -> None:
        sequence = [color for _, color in zip(range(len(colors)), colors, strict=False)]
        for color in sequence:
            expect_type(color, Color)
        interval_ms = get_int(interval)
        self._play([(color, interval_ms) for color in sequence])

    def _play(self, frames: list[tuple[Any, int]]) -> None:
        if frames:
            self._panel.animate("light", (self._set_light(color, duration_ms) for color, duration_ms in itertools.cycle(frames)))

    def _set_light(self, color: Any, duration_ms: int) -> int:
        self._panel.light = (color.h, color.s, color.v) if color is not None and color.v > 0 else None
        return duration_ms

    def _show(self, color: Any) -> None:
        expect_type(color, Color)
        self._panel.stop_animation("light")
        self._set_light(color, 0)


_SIZE = 5
_MAX_BRIGHTNESS = 100
_MAX_FRAMES = 255


class LightMatrix(_Part):
    """Display of 5 by 5 pixels."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._awaited = Awaited(self._loop)

    @charged
    def orientation(self, up: Any) -> None:
        expect_type(up, Side)

    @charged
    def icon(self, icon: Any) -> None:
        self._show(_pixels(icon))

    @charged
    def animate(self, icons: Any, interval: Any) -> None:
        interval_ms = get_int(interval)
        pictures = get_array(icons)
        if not 2 <= len(pictures) <= _MAX_FRAMES:
            raise ValueError("Invalid argument")
        frames = [_pixels(picture) for picture in pictures]

        def animation() -> Iterator[int]:
            for frame in itertools.cycle(frames):
                self._panel.show(frame)
                yield interval_ms

        self._panel.animate("display", animation())

    @charged
    def pixel(self, row: Any, column: Any, brightness: Any = _MAX_BRIGHTNESS) -> None:
        position, value = (get_int(row), get_int(column)), percentage(brightness)
        if self._panel.stop_animation("display"):
            self._panel.show([0] * _SIZE**2)
        if all(0 <= x < _SIZE for x in position):
            pixels = list(self._panel.display)
            pixels[position[0] * _SIZE + position[1]] = value
            self._panel.show(pixels, self._panel.text)

    @charged
    def on(self, brightness: Any = _MAX_BRIGHTNESS) -> None:
        self._show([percentage(brightness)] * _SIZE**2)

    @charged
    def off(self) -> None:
        self._show([0] * _SIZE**2)

    @charged
    def number(self, number: Any) -> None:
        self.show_symbol(get_int(number))

    @charged
    def char(self, char: Any) -> None:
        expect_type(char, str)
        self.show_symbol(char)

    def show_symbol(self, symbol: Any) -> None:
        """Show a character or a number; numbers of more than two digits are shown as < or >."""
        if isinstance(symbol, str):
            if len(symbol) != 1 or not _is_printable(symbol):
                raise ValueError("Invalid argument")
            text = symbol
        else:
            number = get_int(symbol)
            text = ">" if number > 99 else "<" if number < -99 else str(number)
        self._show([0] * _SIZE**2, text)

    def _show(self, pixels: list[int], text: str = "") -> None:
        self._panel.stop_animation("display")
        self._panel.show(pixels, text)

    @charged
    def text(self, text: Any, on: Any = 500, off: Any = 50) -> Any:
        on_ms, off_ms = get_int(on), get_int(off)
        steps = iter(self._text(get_text(text), on_ms, off_ms))
        return self._awaited.finish(lambda: next(steps, True), poll_ms=1)

    def _text(self, text: str, on_ms: int, off_ms: int) -> Iterator[bool]:
        """Show each character and the pause after it; yields False until all is shown."""
        for index, char in enumerate(text):
            self.show_symbol(char)
            yield from self._pause(on_ms)
            if off_ms > 0 or index == len(text) - 1:
                self._show([0] * _SIZE**2)
                yield from self._pause(off_ms)

    def _pause(self, duration_ms: int) -> Iterator[bool]:
        end_ms = self._machine.time_ms + duration_ms
        while self._machine.time_ms < end_ms:
            yield False


def _is_printable(char: str) -> bool:
    return 32 <= ord(char) <= 126


def _pixels(icon: Any) -> list[int]:
    """The brightness of all pixels, row by row.

    Raises:
        ValueError: it has not five rows of five.
    """
    if isinstance(icon, Matrix):
        if icon.shape != (_SIZE, _SIZE):
            raise ValueError("Invalid argument")
        return [int(max(0.0, min(float(_MAX_BRIGHTNESS), value))) for value in icon]
    pixels: list[int] = []
    for row in _five(icon):
        pixels += map(percentage, _five(row))
    return pixels


def _five(values: Any) -> Sequence[Any]:
    if len(get_array(values)) != _SIZE:
        raise ValueError("Invalid argument")
    return get_array(values)


_NOTE = re.compile(r"(?:R|([A-G])([#b]?)([0-9])?)(/)?(\d\d?)?(\.?)(_?)")
_FORBIDDEN_NOTES = ("Cb", "B#", "E#", "Fb")
_SEMITONES = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
_LOWEST_OCTAVE_CHZ = (1635, 1732, 1835, 1945, 2060, 2183, 2312, 2450, 2596, 2750, 2914, 3087)  # C0 to B0


class Speaker(_Part):
    """Loudspeaker; a new sound ends the awaited one."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._volume = 100
        self._awaited = Awaited(self._loop)

    @charged
    def volume(self, volume: Any = None) -> int | None:
        if volume is None:
            return self._volume
        self._volume = percentage(volume)
        return None

    @charged
    def beep(self, frequency: Any = 500, duration: Any = 100) -> Any:
        """Play a tone at once; whoever waits for its end also ends it."""
        self._panel.sound_hz, duration_ms = get_int(frequency), get_int(duration)
        return None if duration_ms < 0 else self._play(self._rest_of_tone(self._machine.time_ms + duration_ms))

    @charged
    def play_notes(self, notes: Any, tempo: Any = 120) -> Any:
        return self._play(self._notes(iter(notes), 4 * 60 * 1000 // get_int(tempo)))

    def _play(self, sounds: Iterator[bool]) -> Any:
        return self._awaited.finish(lambda: next(sounds, True), None, self._silence, poll_ms=1)

    def _rest_of_tone(self, end_ms: int) -> Iterator[bool]:
        while self._machine.time_ms < end_ms:
            yield False
        self._silence()

    def _silence(self) -> None:
        self._panel.sound_hz = 0

    def _notes(self, notes: Iterator[Any], bar_ms: int) -> Iterator[bool]:
        for note in notes:
            yield from self._sound(*_parse_note(note, bar_ms))

    def _sound(self, frequency_hz: int, sound_ms: int, total_ms: int) -> Iterator[bool]:
        """Play a note with the silence at its end; yields False until it is over."""
        start_ms, self._panel.sound_hz = self._machine.time_ms, frequency_hz
        yield from self._rest_of_tone(start_ms + sound_ms)
        while self._machine.time_ms < start_ms + total_ms:
            yield False


def _parse_note(note: Any, bar_ms: int) -> tuple[int, int, int]:
    """Frequency (Hz), duration of the sound and of the whole note (ms). Raises ValueError, with the firmware's message, for an
    invalid note."""
    match = _NOTE.match(get_text(note))
    if match is None:
        raise ValueError("Missing note name A-G or R")
    name, sign, octave, slash, fraction, dot, tie = match.groups()
    if name and name + sign in _FORBIDDEN_NOTES:
        raise ValueError(f"{name}{sign} is not allowed")
    if name and (octave is None or not 2 <= int(octave) <= 8):
        raise ValueError("Missing octave number 2-8")
    if slash is None:
        raise ValueError("Missing /")
    if fraction is None:
        raise ValueError("Missing fractional value 1, 2, 4, 8, etc.")
    total_ms = bar_ms // int(fraction)
    total_ms = 3 * total_ms // 2 if dot else total_ms
    semitone = _SEMITONES[name] + {"#": 1, "b": -1}.get(sign, 0) if name else 0
    frequency_hz = (_LOWEST_OCTAVE_CHZ[semitone] << int(octave)) // 100 if name else 0
    return frequency_hz, total_ms if tie else 7 * total_ms // 8, total_ms


class Keypad(_Part):
    """Buttons of the hub."""

    @charged
    def pressed(self) -> Any:
        down = self._panel.pressed(self._machine.time_ms)
        names = [name for name in ("left", "right", "center", "bluetooth") if name in down]
        return buttons(names, self._machine.robot.hub.model)


ColorLight.__name__ = Keypad.__name__ = ""  # as in the firmware


class Battery(_Part):
    @charged
    def voltage(self) -> int:
        return self._machine.body.battery_mv

    @charged
    def current(self) -> int:
        return _IDLE_CURRENT_MA

    @charged
    def type(self) -> str:
        return "Li-ion" if self._machine.robot.hub.model.is_rechargeable else "Alkaline"

    @charged
    def temperature(self) -> int:
        return _ROOM_TEMPERATURE_MDEG


class Charger(_Part):
    """Charger, never connected."""

    @charged
    def connected(self) -> int:
        return 0

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
        try:
            names = list(button) if button else []
        except TypeError:
            names = [button]
        for name in names:
            if not isinstance(name, Button):
                expect_type(button, Button)
        self._panel.stop_buttons = frozenset(str(name).partition(".")[2].lower() for name in names)

    @charged
    def name(self) -> str:
        return "Pybricks Hub"

    @charged
    def reset_reason(self) -> int:
        return 0

    @charged
    def info(self) -> dict[str, Any]:
        values = {
            "name": self.name(),
            "reset_reason": 0,
            "host_connected_ble": True,
            "host_connected_usb": False,
            "program_start_type": 3,
            "program_id": 0,
        }
        return HubDict.sized(len(values), values.items())

    def shutdown(self) -> None:
        raise SwitchedOff

    @charged
    def storage(self, offset: Any, read: Any = None, write: Any = None) -> bytes | None:
        expect_int(offset, 0 if read is None else read)
        start: int = offset
        if (read is None) == (write is None):
            raise TypeError("Must set either read (int) or write (bytes).")
        data = b"" if write is None else as_bytes(write)
        size = read if write is None else len(data)
        if start < 0 or size < 0 or start + size > _STORAGE_BYTES:
            raise ValueError("Invalid argument")
        if write is None:
            return bytes(self._storage[start : start + size])
        self._storage[start : start + size] = data
        return None

    @charged
    def reset_storage(self) -> None:
        self._storage[:] = bytes(_STORAGE_BYTES)
