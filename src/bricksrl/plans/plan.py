"""A building plan: kinds of parts at their places, in the order in which they are put there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bricksrl.errors import PlanError
from bricksrl.plans import catalogue, ldraw_file
from bricksrl.plans.geometry import Floats
from bricksrl.plans.ldraw_file import Document, Model, Reference
from bricksrl.plans.part import DeviceKind, Part

MAX_PARTS, MAX_DEPTH = 3000, 16
_MAIN_COLOUR = 16


@dataclass(frozen=True, eq=False)
class Placed:
    """A part at its place.

    Attributes:
        index: its place in ``Plan.parts``.
        rotation: [3, 3], from the part's frame to that of the plan.
        position: [3], of the part's origin, LDU.
        step: index of the step that adds it.
        line: of the file that places it.
        assembly: the sub-assemblies that it belongs to, the outermost first; names with the line that uses them.
        port, device: of a motor or sensor: the hub's port that it is plugged into, and its name in the description.
        angle_deg: of a motor: what its rotation sensor shows in this position.
        is_free: meant to turn freely.
        is_fixed: stands fast on the table, and so does what it belongs to.
    """

    index: int
    part: Part
    colour: int
    rotation: Floats
    position: Floats
    step: int
    line: int
    assembly: tuple[str, ...]
    port: str | None
    device: str | None
    angle_deg: float = 0.0
    is_free: bool = False
    is_fixed: bool = False

    def to_plan(self, points: Floats) -> Floats:
        """Points [n, 3] of the part's frame in that of the plan."""
        return np.asarray(points @ self.rotation.T + self.position)

    def to_part(self, points: Floats) -> Floats:
        """Points [n, 3] of the plan's frame in that of the part."""
        return np.asarray((points - self.position) @ self.rotation)

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"{self.part.name} ({self.part.number})"


@dataclass(frozen=True)
class Step:
    """What is done at once.

    Attributes:
        new: indices of the parts that are added.
        joined: sub-assemblies, built in steps before, that are put in place: their parts' indices.
        assembly: where it happens, as in ``Placed.assembly``; empty for the robot itself.
        number: of the step in its model.
        note: text of the plan for this step.
    """

    index: int
    new: tuple[int, ...]
    joined: tuple[tuple[int, ...], ...]
    assembly: tuple[str, ...]
    number: int
    note: str


@dataclass(frozen=True)
class Unknown:
    """A part that the catalogue does not have, and the lines that place it."""

    number: str
    lines: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """A whole plan.

    Attributes:
        robot: name of the robot that the plan says it builds.
        count: number of parts that the plan says it has.
    """

    path: str
    title: str
    robot: str | None
    count: int | None
    parts: tuple[Placed, ...]
    steps: tuple[Step, ...]
    unknown: tuple[Unknown, ...]

    def devices(self, kind: DeviceKind) -> list[Placed]:
        """Its hubs, motors or sensors."""
        return [placed for placed in self.parts if placed.part.device is not None and placed.part.device.kind is kind]

    @property
    def mass_g(self) -> float:
        """Of all known parts."""
        return sum(placed.part.mass_g for placed in self.parts)


def read_plan(path: Path) -> Plan:
    """The plan in an LDraw file.

    Raises:
        PlanError: it cannot be read, or demands too much.
    """
    return make_plan(ldraw_file.parse(ldraw_file.read_text(path), str(path)))


def make_plan(document: Document) -> Plan:
    """The parts and steps of a document.

    Raises:
        PlanError: models that contain themselves, too many parts.
    """
    builder = _Builder(document)
    builder.build(document.main, _MAIN_COLOUR, np.eye(3), np.zeros(3), ())
    unknown = tuple(Unknown(number, tuple(lines)) for number, lines in sorted(builder.unknown.items()))
    title = document.main.title or Path(document.path).stem
    return Plan(document.path, title, document.robot, document.count, tuple(builder.parts), tuple(builder.steps), unknown)


class _Builder:
    """Follows a document from model to model."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.parts: list[Placed] = []
        self.steps: list[Step] = []
        self.unknown: dict[str, list[int]] = {}
        self._visits = 0

    def build(self, model: Model, colour: int, matrix: Floats, offset: Floats, assembly: tuple[str, ...]) -> tuple[int, ...]:
        """Add a model's parts and steps; the indices of its parts."""
        if len(assembly) > MAX_DEPTH:
            raise PlanError(
                f"{self.document.path}, line {model.line}: '{model.name}' is nested more than {MAX_DEPTH} deep or in itself"
            )
        first = len(self.parts)
        for number in range(model.step + 1):
            references = [reference for reference in model.references if reference.step == number]
            joined = tuple(filter(None, (self._join(ref, colour, matrix, offset, assembly) for ref in references)))
            step = len(self.steps)
            new = tuple(filter(None, (self._place(ref, colour, matrix, offset, step, assembly) for ref in references)))
            if new or joined:
                note = model.notes.get(number, "")
                self.steps.append(Step(step, tuple(placed.index for placed in new), joined, assembly, number, note))
        return tuple(range(first, len(self.parts)))

    def _assembly(self, reference: Reference) -> Model | None:
        """The model that a line puts there; ``None`` where it is a part."""
        model = self.document.models.get(ldraw_file.key_of(reference.name))
        return None if model is None or catalogue.find(reference.name) or self._is_drawn(model) else model

    def _is_drawn(self, model: Model) -> bool:
        """Whether a model is one part: a shape, or a hose or cable of stretched pieces."""
        if model.is_shape or not any(reference.is_stretched for reference in model.references):
            return model.is_shape
        models = self.document.models
        return not any(catalogue.find(one.name) or ldraw_file.key_of(one.name) in models for one in model.references)

    def _join(
        self, reference: Reference, colour: int, matrix: Floats, offset: Floats, assembly: tuple[str, ...]
    ) -> tuple[int, ...]:
        model = self._assembly(reference)
        if model is None:
            return ()
        self._count(reference)
        self._check(reference)
        own = colour if reference.colour == _MAIN_COLOUR else reference.colour
        place = matrix @ reference.offset + offset
        return self.build(model, own, matrix @ reference.matrix, place, (*assembly, f"{model.name}:{reference.line}"))

    def _place(
        self,
        reference: Reference,
        colour: int,
        matrix: Floats,
        offset: Floats,
        step: int,
        assembly: tuple[str, ...],
    ) -> Placed | None:
        if self._assembly(reference) is not None:
            return None
        self._count(reference)
        part = catalogue.find(reference.name)
        if part is None:
            self.unknown.setdefault(reference.name.lower().removesuffix(".dat"), []).append(reference.line)
            return None
        self._check(reference)
        placed = Placed(
            len(self.parts),
            part,
            colour if reference.colour == _MAIN_COLOUR else reference.colour,
            matrix @ reference.matrix,
            matrix @ reference.offset + offset,
            step,
            reference.line,
            assembly,
            reference.port,
            reference.device,
            reference.angle_deg,
            reference.is_free,
            reference.is_fixed,
        )
        self.parts.append(placed)
        return placed

    def _check(self, reference: Reference) -> None:
        """Refuse what no part can be; what is unknown, as the pieces of a drawn hose are, may be stretched."""
        if reference.is_stretched:
            where = f"{self.document.path}, line {reference.line}"
            raise PlanError(f"{where}: '{reference.name}' is stretched; place it without scaling")

    def _count(self, reference: Reference) -> None:
        self._visits += 1
        if self._visits > MAX_PARTS:
            raise PlanError(f"{self.document.path}, line {reference.line}: more than {MAX_PARTS} parts; split the plan")
