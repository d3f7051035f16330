"""LDraw files (.ldr, .mpd, and Studio's .io): models, lines, steps, and our comments with data.

Source: LDraw.org's file format specification and its multi-part documents. What each line that
begins with 0 means is declared in `meta_commands`. All sizes are bounded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import dropwhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans import catalogue
from bricktwin.plans.geometry import Floats, Triple
from bricktwin.plans.ldraw_text import MAX_LINES, key_of, unquoted
from bricktwin.plans.meta_commands import Meaning, SynthKind, meaning_of, synth_kind

_LIBRARY_TYPES = ("Part", "Subpart", "Shortcut", "Primitive", "8_Primitive", "48_Primitive")
"""Types that a file of LDraw.org's library declares if it is no assembly."""
_STRETCH_TOLERANCE = 0.02
"""Largest difference, in any number, between the identity and the product of a matrix and its
transpose."""
_MAIN_COLOUR = 16
"""LDraw's code of the colour that a model gets where it is placed."""
_ENDS = {
    "LPUB PART": "0 !LPUB PART END",
    "LPUB BUILD": "0 !LPUB BUILD_MOD END_MOD",
    "MLCAD SKIP": "0 MLCAD SKIP_END",
}
"""Lines that end a range of lines that are no parts, each by the words that it shares with the
first line of the range."""
_MAX_DEG = 36_000.0
"""A hundred turns of a motor."""
_MAX_COORDINATE = 1e6
"""Largest coordinate, LDU. It is 400 m."""
_PLACE_NUMBERS = 12
"""Numbers of a line that places something: a position, and the rows of a matrix."""


@dataclass(frozen=True, kw_only=True)
class Marks:
    """Marks of a part, from our comments before it.

    Attributes:
        port, device: of a motor or sensor: the hub's port, and the name in the description.
        angle_deg: of a motor: reading of its rotation sensor in this position.
        stops_deg: of a motor: readings at which what it drives meets something; ``None`` if nothing
            is said.
        is_free: meant to turn freely.
        is_fixed: fixed to the table, with its body.
        ball: middle of the ball that it holds in a scene with a ball [3], in the part's frame, LDU.
    """

    port: str | None = None
    device: str | None = None
    angle_deg: float = 0.0
    stops_deg: tuple[float, float] | None = None
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
        is_ghost: whether it is no part where its model is a sub-model.
    """

    colour: int
    matrix: Floats
    offset: Floats
    name: str
    step: int
    line: int
    is_stretched: bool
    is_ghost: bool = False


@dataclass
class Model:
    """One model of a document.

    Attributes:
        notes: words by step.
        is_shape: whether it has geometry or is declared a part, and so is no assembly.
        is_drawn: whether it is a cable, hose or band that an editor drew, with the parts at its
            ends.
        is_range: whether it is some lines of another model, which are one drawn piece if no part of
            the catalogue is among them.
        lacks: what it would be, had its program drawn it: "" for all that is whole.
    """

    name: str
    line: int
    title: str = ""
    references: list[Reference] = field(default_factory=list)
    notes: dict[int, list[str]] = field(default_factory=dict)
    is_shape: bool = False
    is_drawn: bool = False
    is_range: bool = False
    lacks: str = ""
    step: int = 0


class LineFault(NamedTuple):
    """A line that places nothing: its number, and what is wrong and what to do."""

    line: int
    text: str


def parse(text: str, path: str) -> "Document":
    """Parse the document of a plan. Raises PlanError if it places no part, or a comment or a name
    is invalid."""
    document = parse_any(text, path)
    # The main model is the first one that places something, because an editor may write a header
    # before it.
    models = dropwhile(lambda item: not item[1].references, document.models.items())
    document.models = dict(models)
    if document.models:
        return document
    if document.faults:
        number, fault = document.faults[0]
        raise PlanError(f"{path}, line {number}: {fault}")
    raise PlanError(f"{path} places no part; give an LDraw file with lines that begin with 1")


def parse_any(text: str, path: str) -> "Document":
    """Parse a document that may place nothing. Raises PlanError if it has too many lines, or a
    comment or a name is invalid."""
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise PlanError(f"{path} has {len(lines)} lines, more than {MAX_LINES}; split the plan")
    document = Document(path)
    for number, line in enumerate(lines, 1):
        document.parse_line(number, line.split())
    # The end of the file ends the last model like any other, so that what is left open is reported.
    document.begin(Model("", len(lines)))
    return document


@dataclass
class _Synth:
    """A drawing of LSynth, while its lines are read.

    Attributes:
        is_shown: whether the parts that it runs around are parts of the model.
        is_drawing: whether the lines are what it has drawn.
        count: number of its segments that are parts.
    """

    line: int
    name: str
    kind: SynthKind
    is_shown: bool
    is_drawing: bool = False
    count: int = 0


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
        self._model: Model | None = None
        self._range: Model | None = None
        self._synth: _Synth | None = None
        self._ignored: dict[str, int] = {}
        """Lines at which a range begins that holds no parts, each by the end that it waits for."""
        self._generator_line = 0
        """Line of this model in which MLCad announces a hose, band or spring; 0 once its segments
        have begun."""
        self._buffers: dict[str, list[Reference]] = {}
        self._marks: dict[str, Any] = {}
        self._marks_line = 0

    @property
    def main(self) -> Model:
        """The first model."""
        return next(iter(self.models.values()))

    def parse_line(
        self,
        number: int,
        words: list[str],
    ) -> None:
        """Parse one line, split into words."""
        match words:
            case ["0", *rest]:
                self._meta(number, rest)
            case ["1", *_]:
                self._reference(number, words)
            # Triangles and quadrilaterals make a model a shape. The ones that editors draw for
            # cables and hoses do not: they stand inside of a model with parts.
            case ["3" | "4", *_] if not (self._ignored or self._synth or self._range):
                self._current(number).is_shape = True

    def _meta(
        self,
        number: int,
        words: list[str],
    ) -> None:
        """Carry out a line that begins with 0. ``words`` are those after it."""
        match meaning_of(words):
            case Meaning.MODEL:
                self._file(number, unquoted(words[1:]))
            case Meaning.NO_MODEL:
                self.begin(Model("", number))
            case Meaning.STEP:
                self._current(number).step += 1
            case Meaning.NOTE:
                model = self._current(number)
                model.notes.setdefault(model.step, []).extend(words[1:])
            case Meaning.OURS:
                self._own_comment(number, words[1:])
            # The buffer is a copy, because the model grows on and a buffer may be retrieved several
            # times.
            case Meaning.STORE:
                self._buffers[words[1]] = list(self._current(number).references)
            case Meaning.RETRIEVE:
                model = self._current(number)
                model.references = list(self._buffers.get(words[1], model.references))
            case (
                Meaning.IGNORED
                | Meaning.END_IGNORED
                | Meaning.SUBSTITUTED
                | Meaning.END_SUBSTITUTED
                | Meaning.GENERATOR
            ):
                self._range_of_lines(number, words)
            # A ghost of a placed part may be a part; ghosts of other lines are comments.
            case Meaning.GHOST if words[1:2] == ["1"]:
                self._reference(number, words[1:], is_ghost=True)
            case (
                Meaning.SYNTH
                | Meaning.END_SYNTH
                | Meaning.SYNTHESIZED
                | Meaning.END_SYNTHESIZED
                | Meaning.SHOW
                | Meaning.HIDE
            ):
                self._lsynth(number, words)
            case Meaning.DRAWN_MODEL | Meaning.SHAPE | None if words:
                self._describe(self._current(number), words)

    def _describe(
        self,
        model: Model,
        words: list[str],
    ) -> None:
        """Note what a line says about its model: that it is drawn, or a shape, or its title."""
        meaning = meaning_of(words)
        if meaning is Meaning.DRAWN_MODEL:
            model.is_drawn = True
        elif meaning is Meaning.SHAPE:
            model.is_shape |= words[1].removeprefix("Unofficial_") in _LIBRARY_TYPES
        # The first comment is the title, but a line that begins with `!` is a command that is not
        # known here.
        elif not words[0].startswith("!"):
            model.title = model.title or " ".join(words)

    def _range_of_lines(
        self,
        number: int,
        words: list[str],
    ) -> None:
        """Carry out a line that begins or ends a range of lines, which are no parts or one
        piece."""
        match meaning_of(words):
            # Lines that MLCad skips are no parts, unless it has just announced that they are its
            # own drawing.
            case Meaning.IGNORED if self._generator_line and words[0] == "MLCAD":
                self._begin_generated(number)
            case Meaning.IGNORED:
                # Only the first beginning is kept, because an error should name that line.
                self._ignored.setdefault(_pair(words), number)
            case Meaning.END_IGNORED:
                if self._ignored.pop(_pair(words), 0) == 0:
                    # Where nothing is ignored, this line ends the segments that MLCad has drawn.
                    self._range = None
            case Meaning.SUBSTITUTED:
                self._begin_range(number, words[words.index("SUB") + 1])
            case Meaning.END_SUBSTITUTED:
                self._range = None
            case Meaning.GENERATOR:
                self._generator_line = number
                # The whole model is a drawing, unless `_begin_generated` finds that only a range of
                # lines is.
                self._current(number).is_drawn = True

    def _lsynth(
        self,
        number: int,
        words: list[str],
    ) -> None:
        """Carry out a line of LSynth."""
        meaning = meaning_of(words)
        synth = self._synth
        if meaning is Meaning.SYNTH and not self._ignored:
            # A drawing without an end is ended by the next one.
            self._end_synth()
            kind = synth_kind(words[2])
            self._synth = _Synth(
                number,
                words[2].lower(),
                kind,
                is_shown=kind.is_band,
            )
            self._current(number)
        elif meaning is Meaning.END_SYNTH:
            self._end_synth()
        elif synth is not None and meaning in (Meaning.SYNTHESIZED, Meaning.END_SYNTHESIZED):
            synth.is_drawing = meaning is Meaning.SYNTHESIZED
        elif synth is not None:
            synth.is_shown = meaning is Meaning.SHOW

    def _end_synth(self) -> None:
        """Place what LSynth draws as one piece, unless its segments are parts."""
        synth = self._synth
        self._synth = None
        if synth is not None and not synth.count:
            # The drawing becomes a model without parts, which counts as one piece.
            drawn = Model(
                f"{synth.name} of line {synth.line}",
                synth.line,
                is_drawn=True,
                lacks=synth.name if synth.kind.is_of_parts else "",
            )
            self.models[key_of(drawn.name)] = drawn
            self._place(
                synth.line,
                _MAIN_COLOUR,
                np.eye(3),
                np.zeros(3),
                drawn.name,
            )

    def _begin_range(
        self,
        number: int,
        name: str,
    ) -> None:
        """Begin lines that are one drawn piece."""
        if not self._ignored:
            self._range = None
            drawn = Model(
                f"{name} of line {number}",
                number,
                is_drawn=True,
                is_range=True,
            )
            self.models[key_of(drawn.name)] = drawn
            # The drawing is placed before it becomes the open range, because it would otherwise
            # contain itself.
            self._place(
                number,
                _MAIN_COLOUR,
                np.eye(3),
                np.zeros(3),
                drawn.name,
            )
            self._range = drawn

    def _begin_generated(self, number: int) -> None:
        """Begin the segments of the hose, band or spring that a line before these names."""
        # Only these segments are a drawing, not the model in which they stand.
        self._current(number).is_drawn = False
        self._begin_range(self._generator_line, "hose, band or spring")
        self._generator_line = 0

    def _current(self, number: int) -> Model:
        """The model that lines belong to."""
        # A file with a single model need not name it; the model then has the name of the file.
        if self._model is None:
            self._model = self.models[""] = Model(Path(self.path).name, number)
        return self._model

    def begin(self, model: Model) -> None:
        """End the present model, and begin another one. Raises PlanError if something has begun
        that does not end, or a comment of ours has no part after it."""
        if self._marks:
            raise self._error(
                self._marks_line,
                "no part follows this comment",
                "move it before the part it describes",
            )
        if self._synth is not None:
            remedy = "write it after the last segment of the cable, hose or chain"
            raise self._error(self._synth.line, "no 0 SYNTH END follows", remedy)
        for pair, line in self._ignored.items():
            remedy = "write it after the last line that is no part"
            raise self._error(line, f"no {_ENDS[pair]} follows", remedy)
        self._model = model
        # Whatever else was begun holds for one model only, and ends with it.
        self._range = None
        self._buffers = {}
        self._generator_line = 0

    def _file(
        self,
        number: int,
        name: str,
    ) -> None:
        key = key_of(name)
        model = Model(name, number)
        if not name or (key in self.models and not key.endswith(".dat")):
            fault = f"'{name}' is the name of two models" if name else "a model without a name"
            raise self._error(number, fault, "give each one its own")
        # A file with embedded parts may hold some of them twice, and the first one counts.
        self.models.setdefault(key, model)
        self.begin(model)

    def _own_comment(
        self,
        number: int,
        words: list[str],
    ) -> None:
        # ROBOT and PARTS describe the file, so they need no part after them as all other comments
        # do.
        if words[:1] not in (["ROBOT"], ["PARTS"]):
            self._marks_line = number
        match words:
            case ["ROBOT", robot]:
                self.robot = robot
            case ["PARTS", count] if count.isdecimal() and len(count) < 6:
                self.count = int(count)
            case _:
                marks = _marks_of(words)
                if not marks:
                    raise self._error(
                        number,
                        f"'{' '.join(words)}' is not understood",
                        "write ROBOT NAME, PARTS COUNT, PORT LETTER [DEVICE [DEGREES]], STOPS LOW "
                        "HIGH, FREE, FIXED or BALL X Y Z",
                    )
                # Marks are joined, because several comments may stand before one part.
                self._marks |= marks

    def _reference(
        self,
        number: int,
        words: list[str],
        is_ghost: bool = False,
    ) -> None:
        drawn = colour_and_numbers(words, _PLACE_NUMBERS, _MAX_COORDINATE)
        name = unquoted(words[2 + _PLACE_NUMBERS :])
        if not self._is_no_part(name):
            if drawn is None or not name:
                self.faults.append(LineFault(number, _unplaced(words)))
            else:
                colour, numbers = drawn
                offset = np.array(numbers[:3])
                matrix = np.array(numbers[3:]).reshape(3, 3)
                self._place(
                    number,
                    colour,
                    matrix,
                    offset,
                    name,
                    is_ghost,
                )
        # The comments before this line described it, even if the line is left out, and must not
        # pass to the next part.
        self._marks = {}

    def _is_no_part(self, name: str) -> bool:
        """Whether a line places no part, because it is ignored or because only LSynth's drawing
        needs it."""
        synth = self._synth
        if self._ignored or synth is None:
            return bool(self._ignored)
        if synth.is_drawing:
            # LSynth's links of a chain are parts; its segments of a hose are not.
            synth.count += synth.kind.is_of_parts
            return not synth.kind.is_of_parts
        # Between these lines stand marks of LSynth too, which the catalogue does not have.
        return not (synth.is_shown and catalogue.find(name))

    def _place(
        self,
        number: int,
        colour: int,
        matrix: Floats,
        offset: Floats,
        name: str,
        is_ghost: bool = False,
    ) -> None:
        model = self._current(number)
        # A matrix is a rotation, maybe with a reflection, if its transpose is its inverse; anything
        # else is stretched.
        stretch = np.abs(matrix @ matrix.T - np.eye(3))  # [3, 3]
        is_stretched = bool(stretch.max() > _STRETCH_TOLERANCE)
        reference = Reference(
            colour,
            matrix,
            offset,
            name,
            model.step,
            number,
            is_stretched,
            is_ghost,
            **self._marks,
        )
        (self._range or model).references.append(reference)

    def _error(
        self,
        number: int,
        fault: str,
        remedy: str,
    ) -> PlanError:
        return PlanError(f"{self.path}, line {number}: {fault}; {remedy}")


def _marks_of(words: list[str]) -> dict[str, Any]:
    """Marks of the part after a comment of ours, by the names of `Marks`; empty if the comment is
    not understood."""
    match words:
        case ["PORT", port, *rest] if len(port) == 1 and len(rest) < 3:
            turn_deg = numbers_of(rest[1:] or ["0"], _MAX_DEG)
            if turn_deg:
                device = rest[0] if rest else None
                return {"port": port.upper(), "device": device, "angle_deg": turn_deg[0]}
        case ["STOPS", *ends]:
            stops_deg = numbers_of(ends, _MAX_DEG)
            if len(stops_deg) == 2 and stops_deg[0] < stops_deg[1]:
                return {"stops_deg": stops_deg}
        case ["FREE" | "FIXED" as mark]:
            return {f"is_{mark.lower()}": True}
        case ["BALL", *place]:
            ball = numbers_of(place, _MAX_COORDINATE)
            if len(ball) == 3:
                return {"ball": ball}
    return {}


def _pair(words: Sequence[str]) -> str:
    """Words that the first line and the last line of a range have in common."""
    return f"{words[0].lstrip('!')} {words[1].partition('_')[0]}"


def _unplaced(words: list[str]) -> str:
    """Why a line places no part, and what to write."""
    if colour_and_numbers(words, _PLACE_NUMBERS) is not None and len(words) > 2 + _PLACE_NUMBERS:
        return (
            f"a number is {_MAX_COORDINATE:,.0f} or more, and places its part 400 m away; write a "
            "position"
        )
    return "cannot place a part; write 1, a colour, 12 numbers and a file"


def colour_and_numbers(
    words: list[str],
    count: int,
    limit: float = math.inf,
) -> tuple[int, tuple[float, ...]] | None:
    """Colour and ``count`` numbers, all finite and below a limit, of a line that draws something;
    ``None`` if one is invalid.

    A colour is hexadecimal after 0x or #, else decimal, also with leading zeros.
    """
    numbers = numbers_of(words[2 : 2 + count], limit)
    try:
        is_hexadecimal = words[1].lower().startswith(("0x", "#"))
        colour = int(words[1].replace("#", "0x"), 16 if is_hexadecimal else 10)
    except (ValueError, IndexError):
        return None
    return (colour, numbers) if len(numbers) == count else None


def numbers_of(words: Sequence[str], limit: float = math.inf) -> tuple[float, ...]:
    """Numbers, all finite and below a limit; empty if a word is none."""
    try:
        numbers = tuple(map(float, words))
    except ValueError:
        return ()
    # NaN is not below any limit, so this test refuses it as well.
    return numbers if all(abs(value) < limit for value in numbers) else ()
