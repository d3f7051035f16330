"""Light, display, loudspeaker and buttons of a hub."""

import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from brickhub.virtual.pybricks.arguments import (
    expect,
    expect_type,
    get_array,
    get_int,
    get_text,
    percentage,
)
from brickhub.virtual.pybricks.context import Awaited, Native
from brickhub.virtual.pybricks.matrix import Matrix
from brickhub.virtual.pybricks.parameters import Color, Side, buttons

_SIZE = 5
"""Rows and columns of the light matrix."""
_QUARTER_TURNS = {"TOP": 0, "FRONT": 0, "RIGHT": 1, "BOTTOM": 2, "BACK": 2, "LEFT": 3}
_MAX_BRIGHTNESS = 100
_MAX_FRAMES = 255
_BUTTON_ORDER = ("left", "right", "center", "up", "down", "left_up", "bluetooth")
"""Buttons in the order in which the firmware asks them."""
# The groups are name, sign, octave, slash, fraction, dot and tie. What must be there is optional in
# the pattern, because the firmware tells which part is missing.
_NOTE = re.compile(r"(?:R|([A-G])([#b]?)([0-9])?)(/)?(\d\d?)?(\.?)(_?)")
_FORBIDDEN_NOTES = ("Cb", "B#", "E#", "Fb")
_SEMITONES = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
# The firmware's table has C0 to B0 in hundredths of a Hz, because each further octave doubles them.
_LOWEST_OCTAVE_CHZ = (1635, 1732, 1835, 1945, 2060, 2183, 2312, 2450, 2596, 2750, 2914, 3087)


class ColorLight(Native):
    """Status light."""

    def on(self, color: Any) -> None:
        self._show(color)

    def off(self) -> None:
        self._machine.panel.stop_animation("light")
        self._set_light(None, 0)

    def blink(
        self,
        color: Any,
        durations: Any,
    ) -> None:
        # A program's own sequence may go on beyond its length, so only that many durations are
        # taken.
        count = len(durations)
        durations_ms = [get_int(duration) for duration in itertools.islice(durations, count)]
        expect(all(duration > 0 for duration in durations_ms))
        self._show(color)
        # The light is on for the first duration, off for the second, and so on.
        frames = []
        for index, duration_ms in enumerate(durations_ms):
            shown_color = None if index % 2 else color
            frames.append((shown_color, duration_ms))
        self._play(frames)

    def animate(
        self,
        colors: Any,
        interval: Any,
    ) -> None:
        sequence = list(itertools.islice(colors, len(colors)))
        for color in sequence:
            expect_type(color, Color)
        interval_ms = get_int(interval)
        self._play([(color, interval_ms) for color in sequence])

    def _play(self, frames: list[tuple[Any, int]]) -> None:
        if frames:
            steps = itertools.starmap(self._set_light, itertools.cycle(frames))
            self._machine.panel.animate("light", steps)

    def _set_light(
        self,
        color: Any,
        duration_ms: int,
    ) -> int:
        """Show a color, and return for how long, as the panel asks of a step of an animation."""
        light = None
        if color is not None and color.v > 0:
            light = self._lit((color.h, color.s, color.v))
        self._machine.panel.change(light=light)
        return duration_ms

    @staticmethod
    def _lit(light: tuple[int, int, int]) -> tuple[int, int, int] | None:
        """What the lamps show of a color; ``None`` for nothing."""
        return light

    def _show(self, color: Any) -> None:
        expect_type(color, Color)
        self._machine.panel.stop_animation("light")
        self._set_light(color, 0)


class _Timed(Native):
    """A part that plays something, which can be awaited."""

    def __init__(self) -> None:
        self._awaited = Awaited(self._context)

    def _play(
        self,
        steps: Iterator[bool],
        on_close: Callable[[], None] | None = None,
    ) -> Any:
        """Play ``steps``, which yield False until all is played."""
        return self._awaited.finish(
            lambda: next(steps, True),
            None,
            on_close,
            poll_ms=1,
        )

    def _until(self, end_ms: int) -> Iterator[bool]:
        while self._machine.time_ms < end_ms:
            yield False


class LightMatrix(_Timed):
    """Display of 5 by 5 pixels."""

    def orientation(self, up: Any) -> None:
        """Turn what is shown from now on."""
        expect_type(up, Side)
        self._machine.panel.quarter_turns = _QUARTER_TURNS[up._name]

    def _turned(self, pixels: list[int]) -> list[int]:
        for _ in range(self._machine.panel.quarter_turns):
            turned = []
            for row in range(_SIZE):
                for column in range(_SIZE):
                    old_row = _SIZE - 1 - column
                    turned.append(pixels[old_row * _SIZE + row])
            pixels = turned
        return pixels

    def icon(self, icon: Any) -> None:
        self._show(_pixels(icon))

    def animate(
        self,
        icons: Any,
        interval: Any,
    ) -> None:
        interval_ms = get_int(interval)
        pictures = get_array(icons)
        expect(2 <= len(pictures) <= _MAX_FRAMES)
        frames = [_pixels(picture) for picture in pictures]

        def animation() -> Iterator[int]:
            for frame in itertools.cycle(frames):
                self._machine.panel.show(self._turned(frame))
                yield interval_ms

        self._machine.panel.animate("display", animation())

    def pixel(
        self,
        row: Any,
        column: Any,
        brightness: Any = _MAX_BRIGHTNESS,
    ) -> None:
        row_index = get_int(row)
        column_index = get_int(column)
        brightness_pct = percentage(brightness)
        panel = self._machine.panel
        if panel.stop_animation("display"):
            panel.show([0] * _SIZE**2)
        # The firmware ignores a pixel outside of the display.
        if not (0 <= row_index < _SIZE and 0 <= column_index < _SIZE):
            return
        # What was shown before stays as it was turned then, and only this pixel is turned now. Its
        # place is found by turning the numbers of all pixels.
        turned_numbers = self._turned([*range(_SIZE**2)])
        place = turned_numbers.index(row_index * _SIZE + column_index)
        pixels = list(panel.display)
        pixels[place] = brightness_pct
        panel.show(pixels, panel.text)

    def on(self, brightness: Any = _MAX_BRIGHTNESS) -> None:
        self._show([percentage(brightness)] * _SIZE**2)

    def off(self) -> None:
        self._show([0] * _SIZE**2)

    def number(self, number: Any) -> None:
        self._show_symbol(get_int(number))

    def char(self, char: Any) -> None:
        expect_type(char, str)
        self._show_symbol(char)

    def _show_symbol(self, symbol: Any) -> None:
        """Show a character or a number; numbers of more than two digits are shown as < or >."""
        if isinstance(symbol, str):
            # The firmware has pictures of the printable ASCII characters only.
            expect(len(symbol) == 1)
            expect(32 <= ord(symbol) <= 126)
            text = symbol
        else:
            number = get_int(symbol)
            text = str(number)
            if number > 99:
                text = ">"
            elif number < -99:
                text = "<"
        self._show([0] * _SIZE**2, text)

    def _show(
        self,
        pixels: list[int],
        text: str = "",
    ) -> None:
        self._machine.panel.stop_animation("display")
        self._machine.panel.show(self._turned(pixels), text)

    def text(
        self,
        text: Any,
        on: Any = 500,
        off: Any = 50,
    ) -> Any:
        on_ms = get_int(on)
        off_ms = get_int(off)
        return self._play(self._text(get_text(text), on_ms, off_ms))

    def _text(
        self,
        text: str,
        on_ms: int,
        off_ms: int,
    ) -> Iterator[bool]:
        """Show each character and the pause after it."""
        for index, char in enumerate(text):
            self._show_symbol(char)
            yield from self._until(self._machine.time_ms + on_ms)
            # Without a pause, characters follow each other directly, and only the last one goes
            # out.
            if off_ms > 0 or index == len(text) - 1:
                self._show([0] * _SIZE**2)
                yield from self._until(self._machine.time_ms + off_ms)


def _pixels(icon: Any) -> list[int]:
    """The brightness of all pixels, row by row.

    Raises:
        ValueError: it has not five rows of five.
    """
    if isinstance(icon, Matrix):
        expect(icon.shape == (_SIZE, _SIZE))
        limit = float(_MAX_BRIGHTNESS)
        return [int(max(0.0, min(limit, value))) for value in icon]
    pixels: list[int] = []
    for row in _five(icon):
        pixels += [percentage(pixel) for pixel in _five(row)]
    return pixels


def _five(values: Any) -> Sequence[Any]:
    array = get_array(values)
    expect(len(array) == _SIZE)
    return array


class Speaker(_Timed):
    """Loudspeaker; a new sound ends the awaited one."""

    _volume = 100

    def volume(self, volume: Any = None) -> int | None:
        if volume is None:
            return self._volume
        self._volume = percentage(volume)
        return None

    def beep(
        self,
        frequency: Any = 500,
        duration: Any = 100,
    ) -> Any:
        """Play a tone at once; whoever waits for its end also ends it."""
        frequency_hz = get_int(frequency)
        duration_ms = get_int(duration)
        self._machine.panel.change(sound_hz=frequency_hz)
        # A negative duration means a tone without an end, for which nobody waits.
        if duration_ms < 0:
            return None
        end_ms = self._machine.time_ms + duration_ms
        return self._play(self._rest_of_tone(end_ms), self._silence)

    def play_notes(
        self,
        notes: Any,
        tempo: Any = 120,
    ) -> Any:
        remaining = iter(notes)
        bar_ms = 4 * 60 * 1000 // get_int(tempo)
        return self._play(self._sounds(remaining, bar_ms), self._silence)

    def _sounds(
        self,
        notes: Iterator[Any],
        bar_ms: int,
    ) -> Iterator[bool]:
        """Play notes one by one; each is read only when its turn comes, as on a hub."""
        for note in notes:
            frequency_hz, sound_ms, total_ms = _parse_note(note, bar_ms)
            yield from self._sound(frequency_hz, sound_ms, total_ms)

    def _rest_of_tone(self, end_ms: int) -> Iterator[bool]:
        yield from self._until(end_ms)
        self._silence()

    def _silence(self) -> None:
        self._machine.panel.change(sound_hz=0)

    def _sound(
        self,
        frequency_hz: int,
        sound_ms: int,
        total_ms: int,
    ) -> Iterator[bool]:
        """Play a note with the silence at its end."""
        start_ms = self._machine.time_ms
        self._machine.panel.change(sound_hz=frequency_hz)
        yield from self._rest_of_tone(start_ms + sound_ms)
        yield from self._until(start_ms + total_ms)


def _parse_note(note: Any, bar_ms: int) -> tuple[int, int, int]:
    """Frequency (Hz), duration of the sound and of the whole note (ms). Raises ValueError, with the
    firmware's message, for an invalid note."""
    match = _NOTE.match(get_text(note))
    if match is None:
        raise ValueError("Missing note name A-G or R")
    name, sign, octave, slash, fraction, dot, tie = match.groups()
    if name and name + sign in _FORBIDDEN_NOTES:
        raise ValueError(f"{name}{sign} is not allowed")
    has_octave = octave is not None and 2 <= int(octave) <= 8
    if name and not has_octave:
        raise ValueError("Missing octave number 2-8")
    if slash is None:
        raise ValueError("Missing /")
    if fraction is None:
        raise ValueError("Missing fractional value 1, 2, 4, 8, etc.")
    total_ms = bar_ms // int(fraction)
    if dot:
        total_ms = 3 * total_ms // 2
    # A rest, R, has no name.
    frequency_hz = 0
    if name:
        semitone = _SEMITONES[name]
        if sign == "#":
            semitone += 1
        elif sign == "b":
            semitone -= 1
        frequency_hz = (_LOWEST_OCTAVE_CHZ[semitone] << int(octave)) // 100
    # The last eighth of a note is silent, unless it is tied to the next one.
    sound_ms = total_ms if tie else 7 * total_ms // 8
    return frequency_hz, sound_ms, total_ms


class Keypad(Native):
    """Buttons of the hub."""

    def pressed(self) -> Any:
        down = self._machine.panel.pressed(self._machine.time_ms)
        model = self._machine.robot.hub.model
        return buttons([name for name in _BUTTON_ORDER if name in down], model)


# These classes have no name in the firmware either.
ColorLight.__name__ = Keypad.__name__ = ""
