"""Building plans: placed parts in building order."""

import functools
import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans import catalogue, ldraw_file, ldraw_text
from bricktwin.plans.assemblies import completed, composed, is_composed, is_known, is_piece
from bricktwin.plans.geometry import Floats, Triple, triple
from bricktwin.plans.ldraw_file import Document, LineFault, Marks, Model, Reference
from bricktwin.plans.part import Device, DeviceKind, Part

# A few lines that nest sub-models can be millions of parts, so what a file can ask for is limited.
MAX_PARTS = 10_000
"""Largest number of parts and sub-models that lines place."""
MAX_DEPTH = 16
"""Largest number of sub-models inside of each other."""
_LONGEST_NUMBER = 60
"""Letters of an unknown part that messages show."""
_MAIN_COLOUR = 16
"""LDraw's code of the colour that a model gets where it is placed."""
_UNDRAWN = (
    "LSynth has not drawn the parts of this {} yet, so that it is one piece, and turns nothing; "
    "let LSynth draw them"
)
_STRETCHED = "'{}' is stretched; place it without scaling"


@dataclass(frozen=True, eq=False)
class Placed(Marks):
    """A part at its place; equal to itself alone, as equal parts stand at many places.

    Attributes:
        index: in ``Plan.parts``.
        rotation: [3, 3], from the part's frame to the plan's.
        position: [3], LDU.
        step: index of the step that adds it.
        line: of the plan's file; of a part in a file beside it, the line that places that file.
        assembly: names of its sub-assemblies with their lines, the outermost first.
    """

    index: int
    part: Part
    colour: int
    rotation: Floats
    position: Floats
    step: int
    line: int
    assembly: tuple[str, ...]

    # Without them `Marks` would compare, for which two unmarked parts are the same one.
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def to_plan(self, points: Floats) -> Floats:
        """Points [n, 3] from the part's frame to the plan's."""
        return np.asarray(points @ self.rotation.T + self.position)

    def point(self, point: Triple | Floats) -> Floats:
        """A point [3] from the part's frame to the plan's."""
        return np.asarray(self.to_plan(np.array([point]))[0])

    def to_part(self, points: Floats) -> Floats:
        """Points [n, 3] from the plan's frame to the part's."""
        # The inverse of a rotation is its transpose; as the points are rows, the two transpositions
        # cancel out.
        return np.asarray((points - self.position) @ self.rotation)

    @functools.cached_property
    def samples(self) -> Floats:
        """Points [n, 3] in the material, in the plan's frame."""
        return self.to_plan(self.part.samples)

    @functools.cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates [3] in the plan's frame."""
        corners = self.to_plan(self.part.corners)
        return corners.min(axis=0), corners.max(axis=0)

    @property
    def name(self) -> str:
        """Name of the part in messages."""
        return f"{self.part.name} ({self.part.number})"

    def with_marks_of(self, reference: Reference) -> "Placed":
        """The motor or sensor with the marks that a comment before its sub-model gives it."""
        marked = self
        if reference.stops_deg is not None:
            marked = replace(marked, stops_deg=reference.stops_deg)
        # A name and an angle only mean something together with a port.
        if reference.port is not None:
            marked = replace(
                marked,
                port=reference.port,
                device=reference.device,
                angle_deg=reference.angle_deg,
            )
        return marked

    @property
    def electric(self) -> Device:
        """The device that this part is: a hub, motor or sensor. Only parts of `Plan.devices` have
        one."""
        assert self.part.device is not None  # noqa: S101
        return self.part.device


@dataclass(frozen=True)
class Step:
    """A building step.

    Attributes:
        new: indices of the parts that are added.
        joined: parts of each sub-assembly that is put in place.
        assembly: as in ``Placed.assembly``; empty for the robot itself.
        number: of the step in its model.
    """

    index: int
    new: tuple[int, ...]
    joined: tuple[tuple[int, ...], ...]
    assembly: tuple[str, ...]
    number: int
    note: str


@dataclass(frozen=True)
class Unknown:
    """A part that is not in the catalogue, and the lines and positions [n, 3] that place it."""

    number: str
    lines: tuple[int, ...]
    positions: Floats = field(compare=False)

    @property
    def is_file(self) -> bool:
        """Whether this is no part but a model in another file, which is missing."""
        return self.number.endswith((".ldr", ".mpd"))


@dataclass(frozen=True)
class Plan:
    """A building plan.

    Attributes:
        robot: name of the robot that it builds.
        count: declared number of parts.
        drawn: lines that place a drawn cable, hose or band: one piece each, without a shape.
        undrawn: lines that place a chain, or the like, whose parts LSynth has not drawn yet, with
            what they lack: one piece each, among those that are drawn.
        faults: lines that are left out.
    """

    path: str
    title: str
    robot: str | None
    count: int | None
    parts: tuple[Placed, ...]
    steps: tuple[Step, ...]
    unknown: tuple[Unknown, ...]
    drawn: tuple[int, ...]
    undrawn: tuple[LineFault, ...]
    faults: tuple[LineFault, ...]

    def devices(self, *kinds: DeviceKind) -> list[Placed]:
        """The hubs, motors or sensors, kind by kind."""
        devices = [placed for placed in self.parts if placed.part.device is not None]
        found: list[Placed] = []
        for kind in kinds:
            found += [placed for placed in devices if placed.electric.kind is kind]
        return found

    def present_parts(self, step: Step) -> set[int]:
        """Indices of the parts that are in the current sub-assembly after a step."""
        present: set[int] = set()
        for earlier in self.steps[: step.index + 1]:
            if earlier.assembly == step.assembly:
                present.update(earlier.new, *earlier.joined)
        return present

    def kind_of(self, step: Step) -> tuple[object, ...]:
        """Key of equal steps: the model of the sub-assembly, the step's index there, and the
        colours of the parts until then. Each step of the robot itself is of its own kind."""
        if not step.assembly:
            return ("", step.index)
        colours = (self.parts[part].colour for part in sorted(self.present_parts(step)))
        # The line that places a copy is left out, because equal copies must have equal keys.
        model = step.assembly[-1].rpartition(":")[0]
        return (model, step.number, *colours)

    @property
    def different_steps(self) -> dict[Step, int]:
        """The steps in order, each with how often it is done: a sub-assembly that is built several
        times is there once."""
        kinds = [self.kind_of(step) for step in self.steps]
        first_steps: dict[tuple[object, ...], Step] = {}
        for kind, step in zip(kinds, self.steps, strict=True):
            first_steps.setdefault(kind, step)
        return {first_steps[kind]: times for kind, times in Counter(kinds).items()}

    @property
    def mass_g(self) -> float:
        """Total mass of the known parts, grams."""
        return sum(placed.part.mass_g for placed in self.parts)


def read_plan(path: Path) -> Plan:
    """Read a plan from an LDraw file, and from the files beside it that it names. Raises PlanError
    if one is unreadable, invalid or too large."""
    return make_plan(ldraw_file.parse(ldraw_text.read_text(path), str(path)), path)


def make_plan(document: Document, path: Path | None = None) -> Plan:
    """The plan of a document, and of the files beside its path, if it has one. Raises PlanError if
    a model contains itself, there are too many parts, no line is valid, or a file cannot be
    read."""
    builder = _Builder(document, SubModels(document, path))
    at_origin = Reference(
        _MAIN_COLOUR,
        np.eye(3),
        np.zeros(3),
        "",
        0,
        0,
        False,
    )
    builder.build(document.main, at_origin, ())
    builder.join_pieces()
    unknown = []
    for name, references in sorted(builder.unknown.items()):
        # A file that is no plan has lines of any length, which messages must not repeat.
        number = name if len(name) <= _LONGEST_NUMBER else f"{name[:_LONGEST_NUMBER]}..."
        lines = tuple(reference.line for reference in references)
        offsets = np.array([reference.offset for reference in references])
        unknown.append(Unknown(number, lines, offsets))
    title = document.main.title or Path(document.path).stem
    faults = (*document.faults, *builder.faults)
    if faults and not (builder.parts or unknown):
        raise PlanError(f"{document.path}, line {faults[0].line}: {faults[0].text}")
    parts = tuple(builder.parts)
    steps = tuple(builder.steps)
    drawn = tuple(builder.drawn)
    return Plan(
        document.path,
        title,
        document.robot,
        document.count,
        parts,
        steps,
        tuple(unknown),
        drawn,
        tuple(builder.undrawn),
        faults,
    )


class SubModels:
    """The models that lines of a plan can place: of the same file, or of a file beside it.

    Args:
        document: the plan.
        path: of its file; ``None`` if there is nothing beside it.
    """

    def __init__(
        self,
        document: Document,
        path: Path | None,
    ) -> None:
        self._document = document
        self._path = path
        self._beside = None if path is None else ldraw_text.Beside(path)
        self._files: dict[Path, Document] = {}
        # Models are found by identity, because they can be changed and so have no hash.
        self._owners: dict[int, tuple[Document, Path]] = {}
        """Document and file of each model that is in another file than the plan's, by the model's
        identity."""

    def find(
        self,
        name: str,
        user: Model,
    ) -> Model | None:
        """The model of that name, as a line of the model ``user`` places it; ``None`` if there is
        none."""
        document, file = self._owners.get(id(user), (self._document, self._path))
        # A model of the same file comes first. A known part is never looked for among other files,
        # which may have its name by chance.
        inside = document.models.get(ldraw_text.key_of(name))
        if inside is not None or self._beside is None or file is None or is_known(name):
            return inside
        found = self._beside.find(name, file)
        return None if found is None else self._main_of(found)

    def file_of(self, model: Model) -> str:
        """Name of the file of a model, if it is another one than the plan's; "" otherwise."""
        owner = self._owners.get(id(model))
        return "" if owner is None else owner[1].name

    def faults(self) -> list[tuple[str, LineFault]]:
        """The lines of other files that are left out, and the names of the files."""
        return [
            (path.name, fault)
            for path, document in self._files.items()
            for fault in document.faults
        ]

    def _main_of(self, path: Path) -> Model:
        """The first model of a file."""
        path = path.resolve()
        # A file that places the plan itself makes a cycle. It gets the very same model, by which
        # `_refuse_cycle` recognises that.
        if self._path is not None and path == self._path.resolve():
            return self._document.main
        if path not in self._files:
            self._read(path)
        document = self._files[path]
        # As in the plan, the main model is the first one that places something.
        for model in document.models.values():
            if model.references:
                return model
        return document.main

    def _read(self, path: Path) -> None:
        """Read another file than the plan's."""
        if len(self._files) >= ldraw_text.MAX_FILES:
            raise PlanError(
                f"{self._path} is made of more than {ldraw_text.MAX_FILES} files; join some "
                "into one .mpd"
            )
        document = ldraw_file.parse_any(ldraw_text.read_text(path), str(path))
        # An empty file gets a model without parts, which is then reported as such.
        document.models.setdefault("", Model(path.name, 0))
        self._files[path] = document
        for model in document.models.values():
            self._owners[id(model)] = (document, path)


class _Builder:
    """Recursive expansion of a document's models."""

    def __init__(
        self,
        document: Document,
        models: SubModels,
    ) -> None:
        self.document = document
        self.models = models
        self.parts: list[Placed] = []
        self.steps: list[Step] = []
        self.unknown: dict[str, list[Reference]] = {}
        self.drawn: list[int] = []
        self.undrawn: list[LineFault] = []
        self.faults: list[LineFault] = []
        self._files: set[str] = set()
        """Names of the other files that are used."""
        self._composed: dict[int, Reference] = {}
        """Parts that may be drawn as several lines, by their indices."""
        self._visits = 0
        self._open: list[Model] = []
        """The models that are being built, each placed by the one before it."""

    def build(
        self,
        model: Model,
        place: Reference,
        assembly: tuple[str, ...],
    ) -> tuple[int, ...]:
        """Add the parts and steps of a model at its place. Returns the indices of its parts."""
        if len(assembly) > MAX_DEPTH:
            raise PlanError(
                f"{self.document.path}, line {model.line}: '{model.name}' is nested more than "
                f"{MAX_DEPTH} deep"
            )
        self._open.append(model)
        first = len(self.parts)
        lines = self._located_lines(model, place, assembly)
        self._add_faults(self.models.file_of(model), place.line)
        for number, lines_of_step in itertools.groupby(lines, lambda line: line[1].step):
            self._build_step(
                model,
                number,
                list(lines_of_step),
                assembly,
            )
        self._open.pop()
        # All parts that were added since are part of this model, because sub-models are built
        # before the next line.
        return tuple(range(first, len(self.parts)))

    def _located_lines(
        self,
        model: Model,
        place: Reference,
        assembly: tuple[str, ...],
    ) -> list[tuple[int, Reference]]:
        """The lines of a model at its place, each with its number in its own file."""
        # MLCad shows a ghost only in a main model.
        is_sub_model = bool(assembly)
        lines_here = [
            reference
            for reference in self._lines(model)
            if not (reference.is_ghost and is_sub_model)
        ]
        is_elsewhere = bool(self.models.file_of(model))
        lines: list[tuple[int, Reference]] = []
        for reference in composed(lines_here):
            # The user edits the plan, so a mistake in another file is reported at the line that
            # places that file.
            line = place.line if is_elsewhere else reference.line
            lines.append((reference.line, replace(_located(reference, place), line=line)))
        return lines

    def _build_step(
        self,
        model: Model,
        number: int,
        lines: list[tuple[int, Reference]],
        assembly: tuple[str, ...],
    ) -> None:
        """Add the parts of a step of a model, after the steps of the sub-models that it joins."""
        inner_models = [self._assembly(reference, model) for _, reference in lines]
        # All lines are checked before any is built: a cycle would never end, and its error should
        # name the line that closes it.
        for (own_line, reference), inner in zip(lines, inner_models, strict=True):
            if inner is not None:
                self._refuse_cycle(
                    inner,
                    model,
                    own_line,
                    reference.name,
                )
        # Sub-models are built before the step that puts them in place.
        joined: list[tuple[int, ...]] = []
        for (own_line, reference), inner in zip(lines, inner_models, strict=True):
            if inner is not None:
                inner_assembly = (*assembly, f"{inner.name}:{own_line}")
                joined.append(self._join(reference, inner, inner_assembly))
        step = len(self.steps)
        new: list[int] = []
        for (_, reference), inner in zip(lines, inner_models, strict=True):
            if inner is None:
                placed = self._place(
                    reference,
                    step,
                    assembly,
                    model,
                )
                if placed is not None:
                    new.append(placed.index)
        groups: list[tuple[int, ...]] = []
        for group in joined:
            if len(group) > 1:
                groups.append(group)
            elif group:
                # A sub-model of a single part is not assembled, so its part belongs to this step.
                part = group[0]
                self.parts[part] = replace(self.parts[part], step=step, assembly=assembly)
                new.append(part)
        if new or groups:
            note = " ".join(model.notes.get(number, ()))
            self.steps.append(
                Step(
                    step,
                    tuple(new),
                    tuple(groups),
                    assembly,
                    number,
                    note,
                )
            )

    def join_pieces(self) -> None:
        """Join the pieces of parts that are in other models than their parts, such as a battery in
        a sub-model of its own."""
        others = [one for references in self.unknown.values() for one in references]
        if not others or not self._composed:
            return
        joined: set[int] = set()
        found = completed(list(self._composed.values()), others)
        for index, (whole, pieces) in zip(self._composed, found, strict=True):
            if not pieces:
                continue
            placed = self.parts[index]
            part = catalogue.get(whole.name)
            self.parts[index] = replace(placed, part=part, position=whole.offset)
            # A mark of the part itself counts before a mark of one of its pieces.
            if placed.port is None and placed.stops_deg is None:
                self.parts[index] = self.parts[index].with_marks_of(whole)
            joined.update(id(others[piece]) for piece in pieces)
        for number, references in list(self.unknown.items()):
            left = [one for one in references if id(one) not in joined]
            if left:
                self.unknown[number] = left
            else:
                del self.unknown[number]

    def _refuse_cycle(
        self,
        inner: Model,
        user: Model,
        line: int,
        name: str,
    ) -> None:
        """Raise PlanError where a line of the model ``user`` places a model that it is part of."""
        if any(model is inner for model in self._open):
            file = self.models.file_of(user) or self.document.path
            raise PlanError(
                f"{file}, line {line}: '{name}' would be nested in itself; remove this line"
            )

    def _lines(self, model: Model) -> Iterator[Reference]:
        """The lines of a model, with those of its ranges that are no drawn pieces."""
        for reference in model.references:
            inner = self.models.find(reference.name, model)
            if inner is not None and inner.is_range and self._holds_parts(inner):
                for piece in inner.references:
                    yield replace(piece, step=reference.step)
            else:
                yield reference

    def _add_faults(
        self,
        file: str,
        line: int,
    ) -> None:
        """Add the lines of another file that are left out, once, with the line that places the
        file."""
        if file and file not in self._files:
            self._files.add(file)
            faults = [fault for name, fault in self.models.faults() if name == file]
            self.faults += [
                LineFault(line, f"in {file}, line {fault.line}: {fault.text}") for fault in faults
            ]

    def _assembly(
        self,
        reference: Reference,
        user: Model,
    ) -> Model | None:
        """The sub-model that a line of the model ``user`` places, or ``None`` for a part."""
        model = self.models.find(reference.name, user)
        if model is None or model.is_shape:
            return None
        # A part of the catalogue may be embedded in the file, with its shape; the catalogue counts.
        if catalogue.find(reference.name) or self._is_drawn(model):
            return None
        # An unknown part may be embedded too. It is made of primitives and may lack the header that
        # would declare it.
        is_part = reference.name.lower().endswith(".dat") and not self._holds_parts(model)
        return None if is_part else model

    def _is_drawn(self, model: Model | None) -> bool:
        """Whether a model is one drawn cable, hose or chain, without parts of the catalogue; others
        draw them as stretched pieces."""
        if model is None:
            return False
        has_stretched = any(piece.is_stretched for piece in model.references)
        is_stretched = has_stretched and not model.is_shape
        if not (model.is_drawn or is_stretched):
            return False
        return not self._holds_parts(model)

    def _holds_parts(self, model: Model) -> bool:
        """Whether a model has parts of the catalogue, or sub-models that are no embedded shapes."""
        found = [self.models.find(part.name, model) for part in model.references]
        for inner in found:
            if inner is None or inner.is_shape:
                continue
            # A drawing that places nothing is a piece and no sub-model.
            is_drawn_piece = inner.is_drawn and not inner.references
            if not is_drawn_piece:
                return True
        # `join_pieces` joins the pieces of parts later, as the battery of a hub, so a model that
        # holds one is a sub-model.
        return any(is_known(part.name) or is_piece(part.name) for part in model.references)

    def _join(
        self,
        reference: Reference,
        model: Model,
        assembly: tuple[str, ...],
    ) -> tuple[int, ...]:
        """Build a sub-model that a line places. Returns the indices of its parts."""
        self._count(reference)
        # Stretching a sub-model would stretch all of its parts, so it is left out whole.
        if reference.is_stretched:
            self.faults.append(LineFault(reference.line, _STRETCHED.format(reference.name)))
            return ()
        steps_before = len(self.steps)
        parts = self.build(model, reference, assembly)
        if not model.references:
            text = f"'{reference.name}' has no parts; draw some in it, or remove this line"
            self.faults.append(LineFault(reference.line, text))
        # A single part needs no steps of its own and belongs to the step that places it.
        if len(parts) == 1:
            del self.steps[steps_before:]
        if reference.is_free or reference.is_fixed or reference.ball is not None:
            raise self._fault(
                reference,
                f"'{reference.name}' is no part; write FREE, FIXED and BALL before a part in it",
            )
        # Marks before a sub-model belong to its motor, so that two copies of one leg can have
        # different ports and stops.
        if reference.port is not None or reference.stops_deg is not None:
            device = self._only_device(reference, parts)
            self.parts[device.index] = device.with_marks_of(reference)
        return parts

    def _only_device(
        self,
        reference: Reference,
        parts: tuple[int, ...],
    ) -> Placed:
        """The motor or sensor in a sub-model. Raises PlanError if there is none, or more than
        one."""
        placed_parts = [self.parts[part] for part in parts]
        electric = [placed for placed in placed_parts if placed.part.device is not None]
        devices = [placed for placed in electric if placed.electric.kind is not DeviceKind.HUB]
        if len(devices) != 1:
            text = (
                f"'{reference.name}' has {len(devices)} motors and sensors; write PORT "
                "before a motor or sensor in it"
            )
            raise self._fault(reference, text)
        return devices[0]

    def _place(
        self,
        reference: Reference,
        step: int,
        assembly: tuple[str, ...],
        model: Model,
    ) -> Placed | None:
        """Add the part that a line places; ``None`` if it is unknown, drawn or left out."""
        self._count(reference)
        part = catalogue.find(reference.name)
        if part is None:
            # A drawn cable counts as one piece, so the unknown segments in its model are not
            # counted.
            piece = self.models.find(reference.name, model)
            if piece is not None and self._is_drawn(piece):
                self.drawn.append(reference.line)
                if piece.lacks:
                    text = _UNDRAWN.format(piece.lacks)
                    self.undrawn.append(LineFault(reference.line, text))
            elif not model.is_drawn:
                number = reference.name.lower().removesuffix(".dat")
                self.unknown.setdefault(number, []).append(reference)
            return None
        if reference.is_stretched:
            self.faults.append(LineFault(reference.line, _STRETCHED.format(reference.name)))
            return None
        rotation = reference.matrix
        marks = reference.marks
        # Editors mirror halves of a model. A symmetric part can be turned to look the same, so only
        # others are refused.
        if np.linalg.det(rotation) < 0.0:
            if part.mirror is None:
                text = (
                    f"'{reference.name}' is mirrored, and {part.name} has a left and a "
                    "right; turn it"
                )
                self.faults.append(LineFault(reference.line, text))
                return None
            # The part is mirrored onto itself first, which changes nothing: two reflections make a
            # rotation.
            rotation = rotation * part.mirror
            marks["ball"] = None
            if reference.ball is not None:
                marks["ball"] = triple(np.array(reference.ball) * part.mirror)
        placed = Placed(
            len(self.parts),
            part,
            reference.colour,
            rotation,
            reference.offset,
            step,
            reference.line,
            assembly,
            **marks,
        )
        self.parts.append(placed)
        if is_composed(reference):
            self._composed[placed.index] = reference
        return placed

    def _count(self, reference: Reference) -> None:
        """Count a line that is followed. Raises PlanError if there are too many."""
        self._visits += 1
        if self._visits > MAX_PARTS:
            raise self._fault(reference, f"more than {MAX_PARTS} parts; split the plan")

    def _fault(
        self,
        reference: Reference,
        text: str,
    ) -> PlanError:
        return PlanError(f"{self.document.path}, line {reference.line}: {text}")


def _located(reference: Reference, place: Reference) -> Reference:
    """A reference in a model, in the frame of the model's place and with its colour."""
    colour = place.colour if reference.colour == _MAIN_COLOUR else reference.colour
    matrix = place.matrix @ reference.matrix
    offset = place.matrix @ reference.offset + place.offset
    return replace(
        reference,
        colour=colour,
        matrix=matrix,
        offset=offset,
    )
