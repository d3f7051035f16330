"""LDraw files (.ldr, .mpd, and Studio's .io): models, lines, steps, and our comments with data.

Source: LDraw.org's file format specification and its multi-part documents. All sizes are bounded.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from itertools import dropwhile
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans.colours import code_of
from bricktwin.plans.geometry import Floats, Triple

MAX_BYTES, MAX_LINES = 8_000_000, 100_000
MARK = "!BRICKSRL"
"""First word of our comments after the 0."""
_STUDIO_MODELS = ("model.ldr", "model2.ldr")
_NO_TITLES = ("Name:", "Author:", "BFC", "ROTATION")
"""First words of lines of a header that are not the title."""
_LIBRARY_TYPES = ("Part", "Subpart", "Shortcut", "Primitive", "8_Primitive", "48_Primitive")
_STRETCH_TOLERANCE = 0.02
_MAX_DEG = 36_000.0
_MAX_COORDINATE = 1e6
"""LDU."""


@dataclass(frozen=True, kw_only=True)
class Marks:
    """What our comments say of a part.

    Attributes:
        port, device: of a motor or sensor: the hub's port, and the name in the description.
        angle_deg: of a motor: reading of its rotation sensor in this position.
        is_free: meant to turn freely.
        is_fixed: fixed to the table, with its body.
        ball: middle of the ball that it holds in a scene with a ball [3], in the part's frame, LDU.
    """

    port: str | None = None
    device: str | None = None
    angle_deg: float = 0.0
    is_free: bool = False
    is_fixed: bool = False
    ball: Triple | None = None

    @property
    def marks(self) -> dict[str, Any]:
        """These fields by name, also of a subclass with further ones."""
        return {field.name: getattr(self, field.name) for field in fields(Marks)}


@dataclass(frozen=True)
class Reference(Marks):
    """A line that places a part or a model.

    Attributes:
        matrix: [3, 3]; orthonormal unless ``is_stretched``.
        offset: [3], LDU.
        step: index in its model.
        is_stretched: whether it is scaled.
    """

    colour: int
    matrix: Floats
    offset: Floats
    name: str
    step: int
    line: int
    is_stretched: bool


@dataclass
class Model:
    """One model of a document.

    Attributes:
        notes: words by step.
        is_shape: whether it has geometry or is declared a part, and so is no assembly.
    """

    name: str
    line: int
    title: str = ""
    references: list[Reference] = field(default_factory=list)
    notes: dict[int, list[str]] = field(default_factory=dict)
    is_shape: bool = False
    step: int = 0


@dataclass(frozen=True)
class Document:
    """A whole file.

    Attributes:
        models: by name in lower case; the first, which is not empty, is the main model.
        robot: name of the robot, from our comment.
        count: declared number of parts.
    """

    path: str
    models: dict[str, Model]
    robot: str | None
    count: int | None

    @property
    def main(self) -> Model:
        """The first model."""
        return next(iter(self.models.values()))


def read_text(path: Path) -> str:
    """Text of an LDraw file, also from inside Studio's zip. Raises PlanError if the file is missing, too large or encrypted."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise PlanError(f"{path}: {error.strerror or error}; name an LDraw file (.ldr, .mpd or .io)") from None
    if data[:4] == b"PK\x03\x04" and len(data) <= MAX_BYTES:
        data = _unzipped(path, data)
    if len(data) > MAX_BYTES:
        raise PlanError(
            f"{path} has more than {MAX_BYTES // 1_000_000} MB; a plan is smaller, so give the model without its renderings"
        )
    if b"\0" in data[:4096]:
        raise PlanError(f"{path} is not a text file; export the model as an LDraw file (.ldr or .mpd)")
    return data.decode("utf-8-sig", errors="replace")


def _unzipped(path: Path, data: bytes) -> bytes:
    """The model inside a Studio file."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            name = next((name for name in _STUDIO_MODELS if name in archive.namelist()), None)
            if name is not None and not archive.getinfo(name).flag_bits & 1:
                with archive.open(name) as file:
                    return file.read(MAX_BYTES + 1)
    except Exception as error:  # noqa: BLE001 - each method of compression has errors of its own
        raise PlanError(f"{path} is a damaged zip ({error}); save it again, or export an LDraw file") from None
    if name is None:
        raise PlanError(f"{path} has no model.ldr; export the model from Studio as an LDraw file")
    raise PlanError(f"{path} is encrypted by Studio; open it there and export it as an LDraw file")


def parse(text: str, path: str) -> Document:
    """Parse a document. Raises PlanError if a line is invalid; the message has its number."""
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise PlanError(f"{path} has {len(lines)} lines, more than {MAX_LINES}; split the plan")
    parser = _Parser(path)
    for number, line in enumerate(lines, 1):
        parser.parse_line(number, line.split())
    parser.begin(Model("", len(lines)))
    models = dict(dropwhile(lambda item: not item[1].references, parser.models.items()))
    if not models:
        raise PlanError(f"{path} places no part; give an LDraw file with lines that begin with 1")
    return Document(path, models, parser.robot, parser.count)


class _Parser:
    """Line-by-line parser."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.models: dict[str, Model] = {}
        self.robot: str | None = None
        self.count: int | None = None
        self._model: Model | None = None
        self._marks: dict[str, Any] = {}
        self._marks_line = 0
        self._handlers: dict[str, Callable[[int, list[str]], None]] = {
            "FILE": self._file,
            "NOFILE": self._end_of_file,
            "STEP": self._step,
            "ROTSTEP": self._step,
            "//": self._note,
            "!LDRAW_ORG": self._declared_type,
            "!LDCAD": self._generated,
            MARK: self._own_comment,
        }

    def parse_line(self, number: int, words: list[str]) -> None:
        """Parse one line, split into words."""
        if not words:
            return
        if words[0] == "0" and len(words) > 1:
            handler = self._handlers.get(words[1])
            if handler is not None:
                handler(number, words[2:])
            elif not (self._current(number).title or words[1].startswith("!") or words[1] in _NO_TITLES):
                self._current(number).title = " ".join(words[1:])
        elif words[0] == "1":
            self._reference(number, words)
        elif words[0] in ("3", "4"):
            self._current(number).is_shape = True

    def _current(self, number: int) -> Model:
        if self._model is None:
            self._model = self.models[""] = Model(Path(self.path).name, number)
        return self._model

    def begin(self, model: Model) -> None:
        """End the present model, and begin another one. Raises PlanError if a comment of ours has no part after it."""
        if self._marks:
            raise self._error(self._marks_line, "no part follows this comment", "move it before the part it describes")
        self._model = model

    def _file(self, number: int, words: list[str]) -> None:
        name = " ".join(words)
        key, model = key_of(name), Model(name, number)
        if not name or (key in self.models and not key.endswith(".dat")):
            fault = f"'{name}' is the name of two models" if name else "a model without a name"
            raise self._error(number, fault, "give each one its own")
        self.models.setdefault(key, model)  # files with embedded parts have some of them twice
        self.begin(model)

    def _end_of_file(self, number: int, _words: list[str]) -> None:
        """The end of a model: what follows, up to the next one, belongs to none."""
        self.begin(Model("", number))

    def _step(self, number: int, _words: list[str]) -> None:
        self._current(number).step += 1

    def _declared_type(self, number: int, words: list[str]) -> None:
        """The declared type of a part file."""
        if words and words[0].removeprefix("Unofficial_") in _LIBRARY_TYPES:
            self._current(number).is_shape = True

    def _generated(self, number: int, words: list[str]) -> None:
        """A file with the segments of a cable or hose, generated by LDCad."""
        if words[:1] == ["GENERATED"] and any(word.startswith("[master=") for word in words):
            self._current(number).is_shape = True

    def _note(self, number: int, words: list[str]) -> None:
        model = self._current(number)
        model.notes.setdefault(model.step, []).extend(words)

    def _own_comment(self, number: int, words: list[str]) -> None:
        key, values = (words[0], tuple(words[1:])) if words else ("", ())
        self._marks_line = self._marks_line if key in ("ROBOT", "PARTS") else number
        if key == "ROBOT" and len(values) == 1:
            self.robot = values[0]
        elif key == "PARTS" and len(values) == 1 and values[0].isdecimal() and len(values[0]) < 6:
            self.count = int(values[0])
        elif key == "PORT" and 0 < len(values) < 4 and len(values[0]) == 1 and (angle_deg := _angle_of(values)) is not None:
            self._marks |= {"port": values[0].upper(), "device": values[1] if len(values) > 1 else None, "angle_deg": angle_deg}
        elif key in ("FREE", "FIXED") and not values:
            self._marks[f"is_{key.lower()}"] = True
        elif key == "BALL" and (ball := _position_of(values)) is not None:
            self._marks["ball"] = ball
        else:
            raise self._error(
                number,
                f"'{' '.join(words)}' is not understood",
                "write ROBOT NAME, PARTS COUNT, PORT LETTER [DEVICE [DEGREES]], FREE, FIXED or BALL X Y Z",
            )

    def _reference(self, number: int, words: list[str]) -> None:
        try:
            colour = code_of(words[1])
            numbers = [float(word) for word in words[2:14]]
        except (ValueError, IndexError):
            numbers = []
            colour = 0
        name = " ".join(words[14:])
        if len(numbers) < 12 or not name or not all(math.isfinite(value) and abs(value) < _MAX_COORDINATE for value in numbers):
            raise self._error(number, "cannot place a part", "write 1, a colour, 12 numbers and a file")
        matrix = np.array(numbers[3:]).reshape(3, 3)
        model = self._current(number)
        is_stretched = bool(np.abs(matrix @ matrix.T - np.eye(3)).max() > _STRETCH_TOLERANCE)
        offset = np.array(numbers[:3])
        model.references.append(Reference(colour, matrix, offset, name, model.step, number, is_stretched, **self._marks))
        self._marks = {}

    def _error(self, number: int, fault: str, remedy: str) -> PlanError:
        return PlanError(f"{self.path}, line {number}: {fault}; {remedy}")


def _angle_of(port: tuple[str, ...]) -> float | None:
    """The angle of a PORT comment, 0 without one, ``None`` if invalid."""
    try:
        angle_deg = float(port[2]) if len(port) > 2 else 0.0
    except ValueError:
        return None
    return angle_deg if abs(angle_deg) <= _MAX_DEG else None


def _position_of(words: tuple[str, ...]) -> Triple | None:
    """The position of a BALL comment, ``None`` if invalid."""
    try:
        x, y, z = map(float, words)
    except ValueError:
        return None
    return (x, y, z) if all(math.isfinite(value) and abs(value) < _MAX_COORDINATE for value in (x, y, z)) else None


def key_of(name: str) -> str:
    """Key for comparing file names."""
    return name.replace("\\", "/").lower()
