"""Text of what is on the bench: sensor readings (``B=red``, ``B=200mm``), constant or over time
from a file, end stops (``C=-90..120``), and the devices on the ports (``A=interactive``)."""

import bisect
import contextlib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import MotorKind, Robot, Sense, SensorKind
from brickhub.robot.hardware import SensorModel, port_name
from brickhub.virtual.readings_file import Row, read_rows
from brickhub.virtual.stimuli import COLORS, Sensed

_ALSO_MEANT = {Sense.TILT: Sense.ROTATION}
"""Of a gyroscope, degrees are a rotation."""
_BUTTON_FORCES_N: Mapping[str, float] = {"pressed": 10.0, "released": 0.0}
_UNIT_SENSES = {"mm": Sense.DISTANCE, "N": Sense.FORCE, "deg": Sense.TILT}
_UNIT_NAMES = {"n": "N"}
"""Units that have capital letters; texts are read in small ones."""
_EXAMPLES = (
    "B=red, B=120,80,50 (hue, saturation, value), B=40%, B=200mm, B=3N, B=pressed, "
    "B=10,-5deg (pitch, roll), B=@file"
)
_CELLS = _EXAMPLES.replace("B=", "").removesuffix(", @file")
"""Examples of cells in a table, none of which depends on what separates its columns."""
_COMMAS = " (a comma separates columns here; write 2.5, or separate columns by ;)"
_COUNTS_BY_UNIT: Mapping[str | None, tuple[int, ...]] = {None: (1, 2, 3), "deg": (1, 2)}
"""Numbers that may have a unit together; one of other units."""
_VALUE_COUNTS = {
    Sense.SURFACE: (1, 3),
    Sense.AMBIENT: (1, 3),
    Sense.TILT: (2,),
    Sense.ROTATION: (1, 2),
    Sense.BEACON: (2,),
}
"""Numbers of values that a stimulus can have; one for other senses."""
_PERCENT_SENSES = (Sense.SURFACE, Sense.AMBIENT, Sense.BEACON)
_PORT = "[A-Fa-f]|[Ss]?[1-4]"
_READING = re.compile(rf"({_PORT})(?:\.([a-z]+))?=(.+)")
_OTHER_UNIT = re.compile(r"[-+.\d,\s]*\d\s*([^\W\d]+)")
_NUMBERS = re.compile(r"([-+.\d,\s]+?)\s*(mm|%|n|deg)?")
_END_STOP = re.compile(rf"({_PORT})=(-?[\d.]+)\.\.(-?[\d.]+)")


T = TypeVar("T")


@dataclass(frozen=True)
class GivenReading:
    """Readings of one sensor over time.

    Attributes:
        port: letter of the port.
        sense: what is sensed; ``None`` for the sensor's first sense.
        times_s: simulated seconds, ascending, from which each value holds; the first also before.
        values: one per time.
        units: of each value, such as ``mm``; empty for one that is written without.
        places: where each value is written, for messages; empty for one on the command line.
        hint: what may be meant by several numbers where one is sensed, for messages.
    """

    port: str
    sense: Sense | None
    times_s: tuple[float, ...]
    values: tuple[Sensed, ...]
    units: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    hint: str = ""

    def at(self, time_s: float) -> Sensed:
        """The value at a simulated time."""
        index = bisect.bisect_right(self.times_s, time_s) - 1
        # A sensor always senses something, so before its first time the first value holds.
        return self.values[max(0, index)]

    def sense_of(self, device: str) -> Sense:
        """Sense of a device, the name of a kind of sensor, that these values are for. Raises
        TwinError if it has no such sense, or if the values do not suit that."""
        model = SensorKind(device).model
        available = model.senses
        subject = f"the {model.class_name} on port {port_name(self.port)}"
        sense = self.sense
        if sense in _ALSO_MEANT and _ALSO_MEANT[sense] in available:
            sense = _ALSO_MEANT[sense]
        # The first sense is the main one, such as the surface of a color sensor.
        if sense is None and available:
            sense = available[0]
        if sense not in available:
            names = " or ".join(available) or "nothing"
            raise TwinError(f"{subject} senses {names}, not {sense}; give such a reading")
        # Only the device tells what a reading without a sense is for, so values are counted here.
        counts = _VALUE_COUNTS.get(sense, (1,))
        for index, value in enumerate(self.values):
            count = len(value) if isinstance(value, tuple) else 1
            if count in counts:
                continue
            place = f"--reading {self.port}"
            examples = _EXAMPLES
            if self.places:
                examples = _CELLS
                place = self.places[index]
                if count > 1:
                    place += self.hint
            what = f"{value} is not a {sense} for {subject}"
            raise TwinError(f"{place}: {what}; give one such as {examples}")
        for index, unit in enumerate(self.units):
            usual = _unit_of(sense, model)
            if unit in ("", usual):
                continue
            place = self.places[index] if self.places else f"--reading {self.port}"
            wanted = f"in {usual}" if usual else "without a unit"
            raise TwinError(f"{place}: {subject} has its {sense} {wanted}, not in {unit}")
        return sense


def _unit_of(sense: Sense, model: SensorModel) -> str:
    """Unit in which a sensor of that kind senses, as a reading has it; empty for none."""
    if sense is Sense.DISTANCE:
        return "mm" if model.range_mm else "%"
    if sense in _PERCENT_SENSES:
        return "%"
    if sense is Sense.FORCE:
        return "N"
    return "" if sense is Sense.COUNT else "deg"


def parse_reading(text: str, folder: Path = Path()) -> GivenReading:
    """Parse ``B=red``, ``B.ambient=20%`` or ``B=@distances.csv`` (lines ``seconds, value``), a file
    in ``folder``. Raises TwinError if the text is invalid, or the file cannot be read."""
    match = _READING.fullmatch(text.strip())
    if match is None:
        raise _no_reading(text)
    written_port, name, written = match.groups()
    port = port_of(written_port)
    value = written.strip()
    if name is not None and name not in set(Sense):
        known = ", ".join(Sense)
        raise TwinError(f"'{text}': nothing senses '{name}'; choose from {known}")
    sense = Sense(name) if name else None
    if not value.startswith("@"):
        stimulus, unit = _value(value, text)
        return GivenReading(
            port,
            sense or _sense_told_by(value, unit),
            (0.0,),
            (stimulus,),
            (unit,),
        )
    # Each line of a file may have its own unit or none, so the units do not tell its sense.
    file_name = value.removeprefix("@")
    rows = read_rows(folder / file_name)
    times_s = tuple(row.time_s for row in rows)
    values, units = zip(*map(_value_of_row, rows), strict=True)
    places = tuple(row.place for row in rows)
    return GivenReading(
        port,
        sense,
        times_s,
        values,
        units,
        places,
        _hint_of(rows[0]),
    )


def port_of(text: str) -> str:
    """The port that a text such as ``b=red`` or ``S2=nothing`` begins with."""
    return text.partition("=")[0].strip().upper().removeprefix("S")


def _hint_of(row: Row) -> str:
    """Hint for several numbers in a table with such rows: most likely one with a decimal comma is
    meant, if commas separate the columns."""
    return _COMMAS if row.separator == "," else ""


def _no_reading(text: str, examples: str = _EXAMPLES) -> TwinError:
    return TwinError(f"'{text}' is not a reading; give one such as {examples}")


def _value_of_row(row: Row) -> tuple[Sensed, str]:
    has_comma = re.match(r"\d+\s*,", row.text)
    hint = _hint_of(row) if has_comma else ""
    return _value(row.text, f"{row.place}{hint}: {row.text}", _CELLS)


def _value(
    value: str,
    text: str,
    examples: str = _EXAMPLES,
) -> tuple[Sensed, str]:
    """Stimulus of a text, and its unit, empty without one. ``text``, ``examples``: for
    messages."""
    word = value.lower()
    if word.upper() in COLORS:
        return COLORS[word.upper()], ""
    if word in _BUTTON_FORCES_N:
        return _BUTTON_FORCES_N[word], ""
    match = _NUMBERS.fullmatch(word)
    numbers: tuple[float, ...] = ()
    unit = None
    if match is not None:
        written, unit = match.groups()
        # Text that is no number after all, such as "1..2", leaves no value.
        with contextlib.suppress(ValueError):
            numbers = tuple(map(float, written.split(",")))
    other_unit = _OTHER_UNIT.fullmatch(word) if match is None else None
    if other_unit is not None:
        raise TwinError(
            f"'{text}' is in {other_unit[1]}; write it in mm, N, % or deg: 355 mm for 35.5 cm"
        )
    suits_unit = len(numbers) in _COUNTS_BY_UNIT.get(unit, (1,))
    are_finite = all(map(math.isfinite, numbers))
    if not suits_unit or not are_finite:
        raise _no_reading(text, examples)
    stimulus: Sensed = numbers if len(numbers) > 1 else numbers[0]
    return stimulus, _UNIT_NAMES.get(unit or "", unit or "")


def _sense_told_by(value: str, unit: str) -> Sense | None:
    """The sense of a reading that its name or its unit tells; ``None`` if neither does."""
    word = value.lower()
    if word.upper() in COLORS:
        return Sense.SURFACE
    if word in _BUTTON_FORCES_N:
        return Sense.FORCE
    return _UNIT_SENSES.get(unit)


def parse_end_stop(text: str) -> tuple[str, tuple[float, float]]:
    """Port and angles (deg) of ``C=-90..120``. Raises DescriptionError if the text is invalid."""
    refusal = f"'{text}' is not a pair of end stops; give one such as C=-90..120"
    match = _END_STOP.fullmatch(text.strip())
    if match is None:
        raise DescriptionError(refusal)
    try:
        low = float(match[2])
        high = float(match[3])
    except ValueError:
        raise DescriptionError(refusal) from None
    if not low <= 0.0 <= high:
        raise DescriptionError(
            f"'{text}': the motor starts at 0; give a lowest angle below that and a highest "
            "above it"
        )
    return port_of(match[1]), (low, high)


def parse_start(text: str) -> tuple[str, float]:
    """Port and angle (deg of the shaft) of ``A=90``. Raises DescriptionError if the text is
    invalid."""
    refusal = f"'{text}' is not a start angle; give one such as A=90, from -180 to 179 degrees"
    port, _, number = (part.strip() for part in text.partition("="))
    try:
        angle_deg = float(number)
    except ValueError:
        raise DescriptionError(refusal) from None
    # The encoder of a motor tells where it stands within a turn, and no more.
    if not re.fullmatch(_PORT, port) or not -180.0 <= angle_deg < 180.0:
        raise DescriptionError(refusal)
    return port_of(port), angle_deg


def by_port(option: str, pairs: Iterable[tuple[str, T]]) -> dict[str, T]:
    """Values of an option such as ``--start`` by their port. Raises DescriptionError if a port has
    two, as one of them would be dropped unseen."""
    found: dict[str, T] = {}
    for port, value in pairs:
        if port in found:
            raise DescriptionError(f"{option} names port {port} twice; name it once")
        found[port] = value
    return found


def end_stops_of(robot: Robot, texts: Iterable[str]) -> dict[str, tuple[float, float]]:
    """End stops (deg of the output) by name of the motor, of texts such as ``C=-90..120`` (deg of
    the shaft). Raises DescriptionError if a text is invalid, or the robot has no motor on the
    port."""
    motors = {motor.port: motor for motor in robot.motors}
    stops = {}
    given = by_port("--end-stop", map(parse_end_stop, texts))
    for port, angles_deg in given.items():
        if port not in motors:
            known = ", ".join(motors) or "none"
            raise DescriptionError(
                f"'{robot.name}' has no motor on port {port} for an end stop; it has motors "
                f"on {known}"
            )
        motor = motors[port]
        # For a motor that counts up counterclockwise, the lowest angle becomes the highest.
        low, high = sorted(angle / motor.shaft_turns for angle in angles_deg)
        stops[motor.name] = low, high
    return stops


def parse_device(text: str) -> tuple[str, MotorKind | SensorKind | None]:
    """Port and device of ``A=interactive``, ``B=ColorSensor`` or ``C=nothing`` (``None``), in
    letters of any case. Of a class that two families have, it is the kind of SPIKE's. Raises
    DescriptionError if there is no such device."""
    port, _, name = (part.strip() for part in text.partition("="))
    devices: dict[str, MotorKind | SensorKind] = {
        kind.model.class_name.lower(): kind for kind in reversed(SensorKind)
    }
    devices |= {kind.value.lower(): kind for kind in (*MotorKind, *SensorKind)}
    is_known = name.lower() in ("nothing", *devices)
    if is_known and re.fullmatch(_PORT, port):
        return port_of(port), devices.get(name.lower())
    classes = dict.fromkeys(kind.model.class_name for kind in SensorKind)
    known = ", ".join((*(kind.value for kind in MotorKind), *classes))
    raise DescriptionError(
        f"'{text}' is not a device on a port; give one such as A=interactive, of {known}, "
        "or nothing"
    )
