"""Log of a run: what each motor and sensor of a virtual hub did over time."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from brickhub.virtual.firmware.servo import Servo

_MOST_ROWS = 100_000


class RunLog:
    """A row every 10 ms of simulated time, and one at the end: the motors as the firmware knows
    them, and what the program last read from its sensors.

    It measures nothing itself, so a run with a log is the same as one without. At most 100,000 rows
    are kept, some 15 MB with two motors and a sensor: each time that they are full, after 1,000 s
    at first, every second row goes, and ``period_ms`` doubles.

    Columns: ``time_s``; for a motor ``A_angle_deg``, ``A_speed_deg_s``, ``A_load_mnm``,
    ``A_voltage_mv`` (empty while it coasts); for what the program reads ``B_reflection_pct``,
    ``C_distance_mm``, ``heading_deg`` and so on, empty until then.
    """

    def __init__(self) -> None:
        self.period_ms = 10
        self._cells: dict[str, str] = {}
        self._lines: list[str] = []

    def sample(
        self,
        time_ms: int,
        servos: Mapping[str, Servo],
    ) -> None:
        """Add a row, after the control loop, or at the end of the run; it replaces one of the same
        time."""
        for port, servo in servos.items():
            angle_deg, speed_deg_s, load_mnm, voltage_mv = servo.observed()
            self._set(f"{port}_angle_deg", angle_deg)
            self._set(f"{port}_speed_deg_s", speed_deg_s)
            self._set(f"{port}_load_mnm", load_mnm)
            self._set(f"{port}_voltage_mv", voltage_mv)
        # Simulated time counts whole milliseconds, so three digits are exact.
        time = f"{time_ms / 1000:.3f}"
        # A run may end at the time of its last row.
        if self._lines and self._lines[-1].startswith(f"{time},"):
            self._lines.pop()
        line = ",".join((time, *self._cells.values()))
        self._lines.append(line)
        if len(self._lines) == _MOST_ROWS:
            del self._lines[::2]
            self.period_ms *= 2

    def read(
        self,
        columns: Sequence[str],
        value: Any,
    ) -> None:
        """Keep what the program reads: one value, or a tuple of one for each column."""
        parts = value if isinstance(value, tuple) else (value,)
        for column, part in zip(columns, parts, strict=True):
            self._set(column, part)

    def csv(self) -> str:
        """The log as a table of comma-separated values."""
        header = ",".join(("time_s", *self._cells))
        return "\n".join((header, *self._lines, ""))

    def rows(self) -> Iterator[dict[str, float | str | None]]:
        """Each row by column: a number, a text such as ``Color.RED``, or ``None`` for an empty
        cell."""
        for row in csv.DictReader(self.csv().splitlines()):
            yield {column: _value(text) for column, text in row.items()}

    def _set(
        self,
        column: str,
        value: object,
    ) -> None:
        # A sensor is read for the first time here, so all rows before get an empty cell.
        if column not in self._cells:
            self._lines = [f"{line}," for line in self._lines]
        self._cells[column] = _text(value)


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        # Adding 0.0 turns -0.0 into 0.0. A hub's float has about seven digits.
        return f"{value + 0.0:.7g}"
    if isinstance(value, bool):
        value = int(value)
    text = str(value)
    # Colors such as Color(h=0, s=100, v=100) contain commas.
    return f'"{text}"' if "," in text else text


def _value(text: str) -> float | str | None:
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text
