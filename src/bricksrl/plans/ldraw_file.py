"""Text of LDraw files (.ldr, .mpd, and .io of Studio): its models, their lines, steps, and our comments that are data.

The format is that of the LDraw.org file format specification and its multi-part documents. What a file may demand is bounded.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bricksrl.errors import PlanError
from bricksrl.plans.geometry import Floats

MAX_BYTES, MAX_LINES = 8_000_000, 100_000
MARK = "!BRICKSRL"
"""How our comments begin, after their 0."""
_STUDIO_MODELS = ("model.ldr", "model2.ldr")
_DAMAGE = (zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, ValueError, LookupError, OSError, EOFError, RuntimeError)
"""Errors of the zip reader at bytes that are damaged."""
_OF_THE_LIBRARY = ("Part", "Subpart", "Shortcut", "Primitive", "8_Primitive", "48_Primitive")
_STRETCH = 0.02
_MOST_DEG = 36_000.0


@dataclass(frozen=True)
class Reference:
    """A line that puts a part or a model somewhere.

    Attributes:
        matrix: [3, 3]; orthonormal unless the line stretches what it places.
        offset: [3], LDU.
        step: of its model, counted from 0.
        port, device: what our comment before it says: the hub's port, and the name of the motor or sensor in the description.
        angle_deg: what that motor's rotation sensor shows in the plan's position, by the same comment.
        is_free: our comment before it says that it may turn freely.
        is_fixed: our comment before it says that it stands fast.
        is_stretched: whether it is scaled, as parts never are.
    """

    colour: int
    matrix: Floats
    offset: Floats
    name: str
    step: int
    line: int
    port: str | None = None
    device: str | None = None
    angle_deg: float = 0.0
    is_free: bool = False
    is_fixed: bool = False
    is_stretched: bool = False


@dataclass
class Model:
    """One file of a document.

    Attributes:
        notes: text for each step that has some.
        is_shape: whether it draws something itself, or says that it is of the part library, so that it is a part and no assembly.
    """

    name: str
    line: int
    title: str = ""
    references: list[Reference] = field(default_factory=list)
    notes: dict[int, str] = field(default_factory=dict)
    is_shape: bool = False
    step: int = 0


@dataclass(frozen=True)
class Document:
    """A whole file.

    Attributes:
        models: by their names in lower case, the first one is what is built.
        robot: name of the robot that it says it builds.
        count: number of parts that it says it has.
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
    """The text of an LDraw file, also of one inside Studio's zip.

    Raises:
        PlanError: there is none, it is too large, or it is encrypted.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise PlanError(f"{path}: {error.strerror or error}; name an LDraw file (.ldr, .mpd or .io)") from None
    if data[:4] == b"PK\x03\x04":
        data = _unzipped(path, data)
    if len(data) > MAX_BYTES:
        raise PlanError(
            f"{path} has more than {MAX_BYTES // 1_000_000} MB; a plan is smaller, so give the model without its renderings"
        )
    if b"\0" in data[:4096]:
        raise PlanError(f"{path} is no text; export the model as an LDraw file (.ldr or .mpd)")
    return data.decode("utf-8-sig", errors="replace")


def _unzipped(path: Path, data: bytes) -> bytes:
    """The model in a file of Studio."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = set(archive.namelist())
            name = next((name for name in _STUDIO_MODELS if name in names), None)
            if name is None:
                raise PlanError(f"{path} holds no model.ldr; export the model from Studio as an LDraw file")
            if archive.getinfo(name).flag_bits & 1:
                raise PlanError(f"{path} is encrypted by Studio; open it there and export it as an LDraw file")
            with archive.open(name) as file:
                return file.read(MAX_BYTES + 1)
    except (
        zipfile.BadZipFile,
        zipfile.LargeZipFile,
        zlib.error,
        ValueError,
        LookupError,
        OSError,
        EOFError,
        RuntimeError,
    ) as error:
        raise PlanError(f"{path} is a damaged zip ({error}); save it anew, or export an LDraw file") from None


def parse(text: str, path: str) -> Document:
    """A document from its text.

    Raises:
        PlanError: a line that cannot be what it is meant to be, with its number.
    """
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise PlanError(f"{path} has {len(lines)} lines, more than {MAX_LINES}; split the plan")
    parser = _Parser(path)
    for number, line in enumerate(lines, 1):
        parser.take(number, line.split())
    if not any(model.references for model in parser.models.values()):
        raise PlanError(f"{path} places no part; give an LDraw file with lines that begin with 1")
    return Document(path, parser.models, parser.robot, parser.count)


class _Parser:
    """Takes line after line."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.models: dict[str, Model] = {}
        self.robot: str | None = None
        self.count: int | None = None
        self._model: Model | None = None
        self._next: dict[str, tuple[str, ...]] = {}
        self._takers: dict[str, Callable[[int, list[str]], None]] = {
            "FILE": self._file,
            "STEP": self._step,
            "ROTSTEP": self._step,
            "//": self._note,
            "!LDRAW_ORG": self._kind,
            "!LDCAD": self._generated,
            MARK: self._ours,
        }

    def take(self, number: int, words: list[str]) -> None:
        """One line, in words."""
        if not words:
            return
        if words[0] == "0" and len(words) > 1:
            taker = self._takers.get(words[1])
            if taker is not None:
                taker(number, words[2:])
            elif not self._current(number).title and not words[1].startswith("!"):
                self._current(number).title = " ".join(words[1:])
        elif words[0] == "1":
            self._reference(number, words)
        elif words[0] in ("3", "4"):
            self._current(number).is_shape = True

    def _current(self, number: int) -> Model:
        if self._model is None:
            self._model = self.models[""] = Model(Path(self.path).name, number)
        return self._model

    def _file(self, number: int, words: list[str]) -> None:
        name = " ".join(words)
        key = key_of(name)
        if key in self.models and key.endswith(".dat"):
            self._model = Model(name, number)  # files that carry their parts along carry some of them twice
            return
        if not name or key in self.models:
            raise self._error(
                number, f"'{name}' is the name of two models" if name else "a model without a name", "give each one its own"
            )
        self._model = self.models[key] = Model(name, number)

    def _step(self, number: int, _words: list[str]) -> None:
        self._current(number).step += 1

    def _kind(self, number: int, words: list[str]) -> None:
        """What a file of the part library says it is."""
        if words and words[0].removeprefix("Unofficial_") in _OF_THE_LIBRARY:
            self._current(number).is_shape = True

    def _generated(self, number: int, words: list[str]) -> None:
        """The segments of a cable or hose that LDCad has drawn into a file of their own."""
        if words[:1] == ["GENERATED"] and any(word.startswith("[master=") for word in words):
            self._current(number).is_shape = True

    def _note(self, number: int, words: list[str]) -> None:
        model = self._current(number)
        model.notes[model.step] = " ".join([*([model.notes[model.step]] if model.step in model.notes else []), *words])

    def _ours(self, number: int, words: list[str]) -> None:
        what, rest = (words[0], tuple(words[1:])) if words else ("", ())
        if what == "ROBOT" and len(rest) == 1:
            self.robot = rest[0]
        elif what == "PARTS" and len(rest) == 1 and rest[0].isdecimal() and len(rest[0]) < 6:
            self.count = int(rest[0])
        elif (what == "PORT" and 0 < len(rest) < 4 and len(rest[0]) == 1 and _angle_of(rest) is not None) or (
            what in ("FREE", "FIXED") and not rest
        ):
            self._next[what] = rest
        else:
            raise self._error(
                number,
                f"'{' '.join(words)}' is not understood",
                "write ROBOT NAME, PARTS COUNT, PORT LETTER [DEVICE [DEGREES]], FREE or FIXED",
            )

    def _reference(self, number: int, words: list[str]) -> None:
        try:
            colour = int(words[1], 0)
            numbers = [float(word) for word in words[2:14]]
        except (ValueError, IndexError):
            numbers = []
            colour = 0
        name = " ".join(words[14:])
        if len(numbers) < 12 or not name or not all(math.isfinite(value) and abs(value) < 1e6 for value in numbers):
            raise self._error(number, "no part can be placed by it", "write 1, a colour, 12 numbers and a file")
        matrix = np.array(numbers[3:]).reshape(3, 3)
        model = self._current(number)
        port = self._next.get("PORT", ())
        reference = Reference(
            colour,
            matrix,
            np.array(numbers[:3]),
            name,
            model.step,
            number,
            port[0].upper() if port else None,
            port[1] if len(port) > 1 else None,
            _angle_of(port) or 0.0,
            "FREE" in self._next,
            "FIXED" in self._next,
            bool(np.abs(matrix @ matrix.T - np.eye(3)).max() > _STRETCH),
        )
        model.references.append(reference)
        self._next = {}

    def _error(self, number: int, what: str, remedy: str) -> PlanError:
        return PlanError(f"{self.path}, line {number}: {what}; {remedy}")


def _angle_of(port: tuple[str, ...]) -> float | None:
    """The angle that a PORT comment says, 0 without one; ``None`` where it is no angle."""
    try:
        angle_deg = float(port[2]) if len(port) > 2 else 0.0
    except ValueError:
        return None
    return angle_deg if abs(angle_deg) <= _MOST_DEG else None


def key_of(name: str) -> str:
    """A file's name as references are compared."""
    return name.replace("\\", "/").lower()
