"""LDraw files (.ldr, .mpd, and Studio's .io): models, lines, steps, and our comments with data.

Source: LDraw.org's file format specification and its multi-part documents. All sizes are bounded.
"""

import codecs
import io
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import dropwhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans.geometry import Floats, Triple

MAX_BYTES, MAX_LINES = 8_000_000, 100_000
_STUDIO_MODELS = ("model.ldr", "model2.ldr")
_NO_TITLES = (
    *("Name:", "Author:", "BFC", "ROTATION", "CLEAR", "PAUSE", "SAVE", "WRITE", "PRINT", "GROUP", "MLCAD", "GHOST", "SYNTH"),
    *("CustomBrick", "FlexibleBrickControlPointUnitLength", "NumOfBricks:"),
)
"""First words of lines that are not the title: of LDraw and its editors, and of Studio."""
_LIBRARY_TYPES = ("Part", "Subpart", "Shortcut", "Primitive", "8_Primitive", "48_Primitive")
_STRETCH_TOLERANCE = 0.02
_MAIN_COLOUR = 16
_MAX_DEG, _MAX_COORDINATE = 36_000.0, 1e6
"""Limits of the numbers of a file, the coordinates in LDU."""


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
        is_drawn: whether it is a cable, hose or band that an editor drew, with the parts at its ends.
    """

    name: str
    line: int
    title: str = ""
    references: list[Reference] = field(default_factory=list)
    notes: dict[int, list[str]] = field(default_factory=dict)
    is_shape: bool = False
    is_drawn: bool = False
    step: int = 0


class LineFault(NamedTuple):
    """A line that places nothing: its number, and what is wrong and what to do."""

    line: int
    text: str


def read_text(path: Path) -> str:
    """Text of an LDraw file, also from inside Studio's zip. Raises PlanError if the file is missing, too large or encrypted."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise PlanError(f"{path}: {error.strerror or error}; name an LDraw file (.ldr, .mpd or .io)") from None
    if data[:2] == b"PK" and len(data) <= MAX_BYTES:
        data = _unzipped(path, data)
    if len(data) > MAX_BYTES:
        raise PlanError(
            f"{path} has more than {MAX_BYTES // 1_000_000} MB; a plan is smaller, so give the model without its renderings"
        )
    is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    text = data.decode("utf-16" if is_wide else "utf-8-sig", errors="replace")
    if "\0" in text[:4096]:
        raise PlanError(f"{path} is not a text file; export the model as an LDraw file (.ldr or .mpd)")
    return text


def _unzipped(path: Path, data: bytes) -> bytes:
    """The model inside a Studio file."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith((".ldr", ".mpd"))]
            name = min(names, key=_rank, default=None)
            if name is not None and not archive.getinfo(name).flag_bits & 1:
                with archive.open(name) as file:
                    return file.read(MAX_BYTES + 1)
    except Exception as error:  # noqa: BLE001 - each method of compression has errors of its own
        raise PlanError(f"{path} is a damaged zip ({error}); save it again, or export an LDraw file") from None
    if name is None:
        raise PlanError(f"{path} has no model.ldr; export the model from Studio as an LDraw file")
    raise PlanError(f"{path} is encrypted by Studio; open it there and export it as an LDraw file")


def _rank(member: str) -> int:
    """Place of a member of a Studio file among those that may be the model."""
    name = key_of(member).rpartition("/")[2]
    return (*_STUDIO_MODELS, name).index(name)


def parse(text: str, path: str) -> "Document":
    """Parse a document. Raises PlanError if it places no part, or a comment or a name is invalid."""
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise PlanError(f"{path} has {len(lines)} lines, more than {MAX_LINES}; split the plan")
    document = Document(path)
    for number, line in enumerate(lines, 1):
        document.parse_line(number, line.split())
    document.begin(Model("", len(lines)))
    document.models = dict(dropwhile(lambda item: not item[1].references, document.models.items()))
    if not document.models:
        number, text = document.faults[0] if document.faults else (0, "")
        fault = f", line {number}: {text}" if text else " places no part; give an LDraw file with lines that begin with 1"
        raise PlanError(f"{path}{fault}")
    return document


class Document:
    """A whole file, parsed line by line.

    Attributes:
        models: by name in lower case; the first, which is not empty, is the main model.
        robot: name of the robot, from our comment.
        count: declared number of parts.
        faults: lines that are left out.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.models: dict[str, Model] = {}
        self.robot: str | None = None
        self.count: int | None = None
        self.faults: list[LineFault] = []
        self._drawn: Model | None = None
        self._model: Model | None = None
        self._buffers: dict[str, int] = {}
        self._marks: dict[str, Any] = {}
        self._marks_line = 0

    @property
    def main(self) -> Model:
        """The first model."""
        return next(iter(self.models.values()))

    def parse_line(self, number: int, words: list[str]) -> None:
        """Parse one line, split into words."""
        match words:
            case ["0", "FILE", *name]:
                self._file(number, _unquoted(name))
            case ["0", "NOFILE", *_]:  # what follows, up to the next model, belongs to none
                self.begin(Model("", number))
            case ["0", "STEP" | "ROTSTEP", *_]:
                self._current(number).step += 1
            case ["0", "//", *note]:
                model = self._current(number)
                model.notes.setdefault(model.step, []).extend(note)
            case ["0", "!BRICKSRL", *comment]:
                self._own_comment(number, comment)
            case ["0", "BUFEXCH", buffer, "STORE"]:
                self._buffers[buffer] = len(self._current(number).references)
            case ["0", "BUFEXCH", buffer, "RETRIEVE"]:  # what was placed in between only showed a way
                del self._current(number).references[self._buffers.get(buffer, MAX_LINES) :]
            case ["0", "!LDRAW_ORG", kind, *_]:
                self._current(number).is_shape |= kind.removeprefix("Unofficial_") in _LIBRARY_TYPES
            case ["0", "!LDCAD", "GENERATED", *_]:  # the segments of a cable or hose of LDCad, and parts at its ends
                self._current(number).is_drawn = True
            case ["0", "SYNTH", "BEGIN", kind, *_]:  # what follows are the segments of a cable or hose of LSynth
                drawn = Model(f"{kind.lower()} of line {number}", number, is_drawn=True)
                self._place(number, _MAIN_COLOUR, np.eye(3), np.zeros(3), drawn.name)
                self._drawn = self.models[drawn.name] = drawn
            case ["0", "SYNTH", "END", *_]:
                self._drawn = None
            case ["0", word, *_] if not (word.startswith("!") or word in _NO_TITLES):
                model = self._current(number)
                model.title = model.title or " ".join(words[1:])
            case ["1", *_]:
                self._reference(number, words)
            case ["3" | "4", *_]:
                self._current(number).is_shape = True

    def _current(self, number: int) -> Model:
        if self._model is None:
            self._model = self.models[""] = Model(Path(self.path).name, number)
        return self._model

    def begin(self, model: Model) -> None:
        """End the present model, and begin another one. Raises PlanError if a comment of ours has no part after it."""
        if self._marks:
            raise self._error(self._marks_line, "no part follows this comment", "move it before the part it describes")
        if self._drawn is not None:
            raise self._error(self._drawn.line, "no 0 SYNTH END follows", "write it after the last segment of the cable or hose")
        self._model, self._buffers = model, {}

    def _file(self, number: int, name: str) -> None:
        key, model = key_of(name), Model(name, number)
        if not name or (key in self.models and not key.endswith(".dat")):
            fault = f"'{name}' is the name of two models" if name else "a model without a name"
            raise self._error(number, fault, "give each one its own")
        self.models.setdefault(key, model)  # files with embedded parts have some of them twice
        self.begin(model)

    def _own_comment(self, number: int, words: list[str]) -> None:
        if words[:1] not in (["ROBOT"], ["PARTS"]):
            self._marks_line = number
        match words:
            case ["ROBOT", robot]:
                self.robot = robot
            case ["PARTS", count] if count.isdecimal() and len(count) < 6:
                self.count = int(count)
            case ["PORT", port, *rest] if len(port) == 1 and len(rest) < 3 and (turn := numbers_of(rest[1:] or ["0"], _MAX_DEG)):
                self._marks |= {"port": port.upper(), "device": rest[0] if rest else None, "angle_deg": turn[0]}
            case ["FREE" | "FIXED" as mark]:
                self._marks[f"is_{mark.lower()}"] = True
            case ["BALL", *place] if len(ball := numbers_of(place, _MAX_COORDINATE)) == 3:
                self._marks["ball"] = ball
            case _:
                raise self._error(
                    number,
                    f"'{' '.join(words)}' is not understood",
                    "write ROBOT NAME, PARTS COUNT, PORT LETTER [DEVICE [DEGREES]], FREE, FIXED or BALL X Y Z",
                )

    def _reference(self, number: int, words: list[str]) -> None:
        drawn, name = colour_and_numbers(words, 12, _MAX_COORDINATE), _unquoted(words[14:])
        if self._drawn is not None:
            return
        if drawn is None or not name:
            self.faults.append(LineFault(number, "cannot place a part; write 1, a colour, 12 numbers and a file"))
        else:
            self._place(number, drawn[0], np.array(drawn[1][3:]).reshape(3, 3), np.array(drawn[1][:3]), name)
        self._marks = {}

    def _place(self, number: int, colour: int, matrix: Floats, offset: Floats, name: str) -> None:
        model = self._current(number)
        is_stretched = bool(np.abs(matrix @ matrix.T - np.eye(3)).max() > _STRETCH_TOLERANCE)
        model.references.append(Reference(colour, matrix, offset, name, model.step, number, is_stretched, **self._marks))

    def _error(self, number: int, fault: str, remedy: str) -> PlanError:
        return PlanError(f"{self.path}, line {number}: {fault}; {remedy}")


def colour_and_numbers(words: list[str], count: int, limit: float = math.inf) -> tuple[int, tuple[float, ...]] | None:
    """Colour and ``count`` numbers, all finite and below a limit, of a line that draws something; ``None`` if one is invalid.

    A colour is hexadecimal after 0x or #, else decimal, also with leading zeros.
    """
    numbers = numbers_of(words[2 : 2 + count], limit)
    try:
        colour = int(words[1].replace("#", "0x"), 16 if words[1].lower().startswith(("0x", "#")) else 10)
    except (ValueError, IndexError):
        return None
    return (colour, numbers) if len(numbers) == count else None


def numbers_of(words: Sequence[str], limit: float = math.inf) -> tuple[float, ...]:
    """Numbers, all finite and below a limit; empty if a word is none."""
    try:
        numbers = tuple(map(float, words))
    except ValueError:
        return ()
    return numbers if all(abs(value) < limit for value in numbers) else ()


def _unquoted(words: Sequence[str]) -> str:
    """The name of a file; some editors quote names with spaces."""
    return " ".join(words).strip('"')


def key_of(name: str) -> str:
    """Key for comparing file names."""
    return name.replace("\\", "/").lower()
