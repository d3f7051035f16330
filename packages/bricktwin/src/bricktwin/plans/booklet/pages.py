"""Pages of a booklet: cover, parts, a page for each step, cables; what is on each, and how large.
A5 landscape; printed at 100 %, bars are as long as the parts. No LDraw library, no OpenGL.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bricktwin.plans.booklet.instructions import Instruction, instructions, placed_items
from bricktwin.plans.booklet.parts_list import parts_list
from bricktwin.plans.booklet.picture import (
    VIEWS,
    Picture,
    Shown,
    Studio,
    View,
    extent,
)
from bricktwin.plans.geometry import MM_PER_LDU, Floats
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan

if TYPE_CHECKING:
    pass

DPI = 360
"""Points per inch of a picture, one ray each. A viewer shows the mean of several, and a printer
prints points as small."""
MM_PER_INCH = 25.4
_LIFE_SIZE = MM_PER_LDU / MM_PER_INCH * DPI
"""Points per LDU of a picture as large as the parts."""
_SCALES = tuple(_LIFE_SIZE * 1.15 * 0.84**step for step in range(30))
"""Scales of pictures. They are few, so that the parts of many steps are drawn only once."""
LIST_COLUMNS = 6
_LIST_ROWS = 3
_LIST_PAGE = LIST_COLUMNS * _LIST_ROWS
"""Kinds of parts on a page of the list."""


@dataclass(frozen=True)
class Item:
    """A kind of part, or a sub-assembly, with picture, count and text. ``bar`` is the part that is
    drawn in life size, or ``None``."""

    picture: Picture
    count: int
    text: str
    bar: Placed | None = None


@dataclass(frozen=True)
class Cable:
    """A cable: port, text, and the positions of port and device in the plan [3]."""

    port: str
    text: str
    ends: tuple[Floats, Floats]


@dataclass(frozen=True)
class Page:
    """A page with a title or a step, items, and lines of text below a picture."""

    head: str
    note: str
    picture: Picture | None = None
    items: tuple[Item, ...] = ()
    instruction: Instruction | None = None
    inset: Picture | None = None
    lines: tuple[str, ...] = ()
    cables: tuple[Cable, ...] = ()


class Pages:
    """The pages of a booklet in order, each made when it is asked for.

    Attributes:
        count: number of pages.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._studio = Studio()
        self._entries = parts_list(plan)
        # All steps are made before the first page, which says how many there are.
        self._steps = list(instructions(plan, self._studio))
        self._cables = _cables(plan)
        list_pages = math.ceil(len(self._entries) / _LIST_PAGE)
        self.count = 1 + list_pages + len(self._steps) + bool(self._cables)

    def __iter__(self) -> Iterator[Page]:
        yield self._cover()
        yield from self._list_of_parts()
        for number, step in enumerate(self._steps, 1):
            yield _step_page(self._plan, self._studio, step, number)
        if self._cables:
            yield self._cabling()

    def _cover(self) -> Page:
        text = (
            f"{len(self._plan.parts)} parts of {len(self._entries)} kinds and colours · "
            f"{len(self._steps)} steps · {self._plan.mass_g:.0f} g"
        )
        picture = _fitted(
            self._studio,
            _at_rest(self._plan.parts),
            VIEWS[0],
            (7.4, 4.3),
        )
        return Page(self._plan.title, text, picture)

    def _list_of_parts(self) -> Iterator[Page]:
        samples = {(placed.part, placed.colour): placed for placed in self._plan.parts}
        items = []
        for entry in self._entries:
            sample = samples[entry.part, entry.colour.code]
            picture = _part_picture(self._studio, [sample], (1.05, 0.8))
            name = textwrap.fill(entry.part.name, 22)
            label = f"{name}\n{entry.part.number}\n{entry.colour.name}"
            items.append(Item(picture, entry.count, label))
        for start in range(0, len(items), _LIST_PAGE):
            yield Page("Parts", "", items=tuple(items[start : start + _LIST_PAGE]))

    def _cabling(self) -> Page:
        note = "Plug in the cables last, and keep them away from moving parts."
        # Each cable has a line of text below the picture, which takes this much of its height.
        height = 4.55 - 0.22 * len(self._cables)
        picture = _fitted(
            self._studio,
            _at_rest(self._plan.parts),
            VIEWS[3],
            (7.6, height),
        )
        lines = tuple(cable.text for cable in self._cables)
        return Page(
            "Cables",
            note,
            picture,
            lines=lines,
            cables=self._cables,
        )


def _at_rest(parts: Iterable[Placed]) -> list[Shown]:
    return [Shown(placed, np.zeros(3)) for placed in parts]


def _fitted(
    studio: Studio,
    shown: Sequence[Shown],
    view: View,
    inches: tuple[float, float],
    largest: float = 1.15,
) -> Picture:
    """A picture that fits into a width and height, at most so many times as large as the parts."""
    width, height = extent(shown, view)
    room = min(inches[0] / width, inches[1] / height) * DPI
    # The limit is a little larger than the scale that it must include, which rounding might put
    # just above it.
    limit = min(room, largest * _LIFE_SIZE * 1.001)
    fitting = [scale for scale in _SCALES if scale <= limit]
    zoom = fitting[0] if fitting else _SCALES[-1]
    return studio.picture(shown, view, zoom)


def _part_picture(
    studio: Studio,
    parts: Sequence[Placed],
    inches: tuple[float, float],
) -> Picture:
    """Picture of a part as it lies in the model, or of a sub-assembly."""
    return _fitted(
        studio,
        _at_rest(parts),
        VIEWS[0],
        inches,
        0.87,
    )


def _step_page(
    plan: Plan,
    studio: Studio,
    step: Instruction,
    number: int,
) -> Page:
    """The page of a step."""
    items = []
    for kind, group in placed_items(plan, step).items():
        parts = group[0]
        picture = _part_picture(studio, parts, (1.5, 0.62))
        # Parts that are nested deeper than the step are a finished sub-assembly, which is put in
        # place as one.
        is_part = len(parts[0].assembly) == len(step.assembly)
        if is_part:
            bar = parts[0] if modules_of(parts[0]) else None
            items.append(
                Item(
                    picture,
                    len(group),
                    parts[0].part.name,
                    bar,
                )
            )
        else:
            items.append(Item(picture, len(group), title_of(str(kind[0]))))
    # The picture gets the height that bars in life size and a note leave of the page.
    bars = sum(item.bar is not None for item in items)
    height = 4.7 - 0.36 * bars - (0.25 if step.note else 0.0)
    picture = _fitted(
        studio,
        step.scene.shown,
        step.scene.view,
        (5.7, height),
    )
    inset = None
    if step.inset is not None:
        inset = _fitted(
            studio,
            step.inset.shown,
            step.inset.view,
            (1.7, 1.5),
        )
    return Page(
        str(number),
        step.note,
        picture,
        tuple(items),
        step,
        inset,
    )


def title_of(name: str) -> str:
    """Title of a sub-assembly."""
    return name.removesuffix(".ldr").replace("_", " ")


def modules_of(placed: Placed) -> int:
    """Length of an axle or a straight beam in modules, else 0."""
    low, high = placed.part.bounds
    sizes = sorted(high - low)
    if placed.part.length:
        return placed.part.length
    # A module is 20 LDU: what is wider than one is bent.
    is_straight = placed.part.family == "beams" and sizes[1] < 21.0
    return round(float(sizes[2]) / 20) if is_straight else 0


def _cables(plan: Plan) -> tuple[Cable, ...]:
    """Cables of all motors and sensors."""
    hubs = plan.devices(DeviceKind.HUB)
    positions = dict(hubs[0].electric.ports) if hubs else {}
    cables = []
    # A device at a port that this hub lacks has no cable to draw; `check` reports it.
    devices = plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR)
    for placed in sorted(devices, key=lambda placed: placed.port or ""):
        if placed.port is None or placed.port not in positions:
            continue
        device = placed.electric
        socket = hubs[0].point(positions[placed.port])
        plug = placed.point(device.plug)
        distance_mm = float(np.linalg.norm(socket - plug)) * MM_PER_LDU
        name = f" '{placed.device}'" if placed.device else ""
        text = (
            f"Port {placed.port}: {placed.part.name}{name}, {distance_mm:.0f} mm away; its "
            f"cable has {device.cable_mm:.0f} mm"
        )
        cables.append(Cable(placed.port, text, (socket, plug)))
    return tuple(cables)
