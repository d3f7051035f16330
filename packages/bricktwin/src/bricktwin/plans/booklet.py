"""Building instructions as PDF or HTML: cover, parts list, one page per step, cables. No LDraw library, no OpenGL.

In a step the new parts are coloured and the others faded. Hidden new parts, and pins, axles and bushes behind other new parts,
have an orange outline. On the page of cables both ends have the letter of the port.
"""

from __future__ import annotations

import base64
import html
import io
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from brickhub.errors import PlanError
from brickhub.files import check_writable, write_durably
from bricktwin.drawing import import_matplotlib
from bricktwin.plans.geometry import MM_PER_LDU
from bricktwin.plans.part import DeviceKind, Part
from bricktwin.plans.parts_list import parts_list
from bricktwin.plans.picture import VIEWS, Canvas, Pixels, View, draw
from bricktwin.plans.plan import Placed, Plan, Step

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STEP_SIZE, _COVER_SIZE, _PART_SIZE = (760, 540), (820, 560), (150, 110)
_MIN_VISIBLE = 0.35
"""Minimum visible share of the new parts in the default view; below it another view is chosen."""
_MIN_FASTENER_VISIBLE, _FASTENERS = 0.25, ("pins", "axles", "bushes")
"""Families, and the visible share below which a new part of them is outlined."""
_PART_ZOOM = 2.4
_NOTE_WIDTH = 120
"""Characters per line of a note."""
_COLOURS = 64
_PARTS_PER_PAGE, _PARTS_BESIDE_PICTURE = 16, 8
_MODULE_IN = 8 / 25.4
_CABLE = "#c2410c"
FORMATS = (".pdf", ".html")


@dataclass(frozen=True)
class Item:
    """A kind of part on a page: picture, text, count."""

    picture: Pixels
    count: int
    text: str
    axle: int = 0


@dataclass(frozen=True)
class Cable:
    """A cable: port, text, and positions of port and device in the picture (pixels from the left and top)."""

    port: str
    text: str
    ends: tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Page:
    """A page: a picture or ``None``, items or lines of text, cables, and lengths of axles in modules, drawn at 1:1."""

    head: str
    note: str
    picture: Pixels | None
    items: tuple[Item, ...]
    lines: tuple[str, ...] = ()
    cables: tuple[Cable, ...] = ()
    axles: tuple[int, ...] = ()


def write_booklet(plan: Plan, path: Path) -> int:
    """Write the booklet. Returns the number of pages. Raises PlanError if the suffix is not ``.pdf`` or ``.html``, or the plan
    has no parts."""
    if path.suffix.lower() not in FORMATS:
        raise PlanError(f"{path}: a booklet is a .pdf or .html file; name one of these")
    if not plan.parts:
        raise PlanError(f"{plan.path} has no part that the catalogue knows; run `bricktwin plan check` on it")
    check_writable(path)
    pages = list(pages_of(plan))
    data = _pdf(plan, pages) if path.suffix.lower() == ".pdf" else _html(plan, pages).encode()
    write_durably(path, data)
    return len(pages)


def pages_of(plan: Plan) -> Iterator[Page]:
    """All pages in order."""
    entries = parts_list(plan)
    text = f"{len(plan.parts)} parts of {len(entries)} kinds and colours · {len(plan.steps)} steps · {plan.mass_g:.0f} g"
    yield Page(plan.title, text, draw(plan.parts, _COVER_SIZE), ())
    for start in range(0, len(entries), _PARTS_PER_PAGE):
        items = tuple(
            Item(_part_picture(part, colour.code), entry.count, f"{part.name}\n{part.number} · {colour.name}")
            for entry in entries[start : start + _PARTS_PER_PAGE]
            for part, colour in [(entry.part, entry.colour)]
        )
        yield Page("Parts", "", None, items)
    kinds = [_kind(plan, step) for step in plan.steps]
    for number, (kind, times) in enumerate(Counter(kinds).items(), 1):
        yield from _step_pages(plan, plan.steps[kinds.index(kind)], number, times)
    canvas = Canvas(_STEP_SIZE, VIEWS[3], plan.parts, plan.parts)
    cables = _cables(plan, canvas)
    if cables:
        note = "Plug in the cables last, and keep them away from moving parts."
        yield Page("Cables", note, canvas.picture(set()), (), tuple(cable.text for cable in cables), cables)


def _kind(plan: Plan, step: Step) -> tuple[object, ...]:
    """Key of a repeatable step: the model of its sub-assembly, its index there, and the colours of the parts until then."""
    if not step.assembly:
        return ("", step.index)
    colours = (plan.parts[part].colour for part in sorted(plan.present_parts(step)))
    return (step.assembly[-1].rpartition(":")[0], step.number, *colours)


def _part_picture(part: Part, colour: int) -> Pixels:
    """Picture of one part, at most as large as in the assembly."""
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]) if part.family == "beams" else np.eye(3)
    placed = Placed(0, part, colour, turn, np.zeros(3), 0, 0, ())
    return Canvas(_PART_SIZE, VIEWS[0], [placed], [placed], _PART_ZOOM).picture()


def _step_pages(plan: Plan, step: Step, number: int, times: int) -> Iterator[Page]:
    """Page of a step, after pages of its parts if they are many; repeated steps share one, so pages have their own numbers."""
    new = [plan.parts[index] for index in step.new]
    joined = [plan.parts[index] for group in step.joined for index in group]
    bright = {placed.index for placed in (*new, *joined)}
    present = [plan.parts[index] for index in sorted(plan.present_parts(step))]
    view, picture = _best_view(present, bright, set(step.new))
    title = f" · {_title(step.assembly[-1])}" if step.assembly else ""
    title += f", {times} times" if times > 1 else ""
    hint = "" if view == VIEWS[0] else " (the model is turned)"
    counts = Counter((placed.part, placed.colour) for placed in new)
    items = [Item(_part_picture(part, colour), count, part.name, part.length) for (part, colour), count in counts.items()]
    groups = [[plan.parts[index] for index in group] for group in step.joined]
    names = [(_title(parts[0].assembly[len(step.assembly)]), *(placed.colour for placed in parts)) for parts in groups]
    for name, count in Counter(names).items():
        items.append(Item(draw(groups[names.index(name)], _PART_SIZE), count, str(name[0])))
    axles = tuple(sorted({item.axle for item in items if 0 < item.axle <= 16}))
    if len(items) > _PARTS_BESIDE_PICTURE:
        for start in range(0, len(items), _PARTS_PER_PAGE):
            yield Page(f"{number}{title}", "", None, tuple(items[start : start + _PARTS_PER_PAGE]))
        items = []
    yield Page(f"{number}{title}", step.note + hint, picture, tuple(items), axles=axles)


def _title(assembly: str) -> str:
    """Title of a sub-assembly."""
    return assembly.rpartition(":")[0].removesuffix(".ldr").replace("_", " ")


def _best_view(present: list[Placed], bright: set[int], new: set[int]) -> tuple[View, Pixels]:
    """The default view, or the one that shows the new parts best if they are hidden there."""
    best: list[tuple[float, View, Canvas, Canvas]] = []
    for view in VIEWS:
        canvas = Canvas(_STEP_SIZE, view, present, present)
        ghosts = Canvas(_STEP_SIZE, view, present, [placed for placed in present if placed.index in bright])
        share = canvas.visible(bright) / max(ghosts.visible(bright), 1)
        if not best or share > best[-1][0] + 0.05:
            best.append((share, view, canvas, ghosts))
        if best[-1][0] > _MIN_VISIBLE:
            break
    _, view, canvas, ghosts = best[-1]
    fasteners = _hidden_fasteners([placed for placed in present if placed.index in new], present, view, canvas)
    return view, canvas.picture(bright, (ghosts, *fasteners))


def _hidden_fasteners(new: list[Placed], present: list[Placed], view: View, canvas: Canvas) -> tuple[Canvas, ...]:
    """The barely visible fasteners on a canvas of their own, if any."""
    fasteners = [placed for placed in new if placed.part.family in _FASTENERS]
    alone = Canvas(canvas.size, view, present, fasteners)
    visible = {placed.index: (canvas.visible({placed.index}), alone.visible({placed.index})) for placed in fasteners}
    hidden = [placed for placed in fasteners if visible[placed.index][0] < _MIN_FASTENER_VISIBLE * visible[placed.index][1]]
    return (Canvas(canvas.size, view, present, hidden),) if hidden else ()


def _cables(plan: Plan, canvas: Canvas) -> tuple[Cable, ...]:
    """Cables of all motors and sensors."""
    hubs = plan.devices(DeviceKind.HUB)
    positions = dict(hubs[0].electric.ports) if hubs else {}
    cables = []
    for placed in sorted(plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR), key=lambda placed: placed.port or ""):
        if placed.port is None or placed.port not in positions:
            continue
        device, socket = placed.electric, hubs[0].point(positions[placed.port])
        distance_mm = float(np.linalg.norm(socket - placed.point(device.plug))) * MM_PER_LDU
        name = f" '{placed.device}'" if placed.device else ""
        text = f"Port {placed.port}: {placed.part.name}{name}, {distance_mm:.0f} mm away; its cable has {device.cable_mm:.0f} mm"
        middle = placed.point(np.mean(placed.part.bounds, axis=0))
        (x, y), (x2, y2) = canvas.pixel_of(np.stack([socket, middle])).tolist()
        cables.append(Cable(placed.port, text, ((x, y), (x2, y2))))
    return tuple(cables)


def _pdf(plan: Plan, pages: Iterable[Page]) -> bytes:
    import_matplotlib()
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    buffer, metadata = io.BytesIO(), {"Title": plan.title, "Creator": "BricksRL", "CreationDate": None}
    with rc_context({"text.parse_math": False}), PdfPages(buffer, metadata=metadata) as pdf:
        for number, page in enumerate(pages, 1):
            figure = Figure(figsize=(8.27, 5.83), dpi=110)
            _lay_out(figure, page, number)
            pdf.savefig(figure)
    return buffer.getvalue()


def _lay_out(figure: Figure, page: Page, number: int) -> None:
    """Draw a page on an A5 landscape figure."""
    from matplotlib.patches import Rectangle

    is_list = page.picture is None
    figure.text(0.03, 0.93, page.head, fontsize=24 if len(page.head) < 20 else 16, weight="bold", va="center")
    figure.text(0.03, 0.045, textwrap.fill(page.note, _NOTE_WIDTH), fontsize=9, va="center")
    figure.text(0.975, 0.045, f"{number}", fontsize=9, ha="right", va="center", color="0.4")
    if page.picture is not None:
        left = 0.26 if page.items else 0.05
        axes = figure.add_axes((left, 0.08 + 0.045 * len(page.lines), 0.98 - left, 0.82 - 0.045 * len(page.lines)))
        axes.imshow(_indexed(page.picture).convert("RGB"), interpolation="none")
        axes.set_axis_off()
        badge = {"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": _CABLE, "linewidth": 0.8}
        for cable in page.cables:
            axes.plot(*zip(*cable.ends, strict=True), color=_CABLE, linewidth=1.0)
            for x, y in cable.ends:
                axes.text(x, y, cable.port, fontsize=7, weight="bold", ha="center", va="center", bbox=badge)
    for row, line in enumerate(reversed(page.lines)):
        figure.text(0.05, 0.09 + 0.045 * row, line, fontsize=10, va="center")
    columns = 4 if is_list else 1
    height = 0.205 if is_list else min(0.175, 0.74 / max(len(page.items), 1))
    for index, item in enumerate(page.items):
        x, y = 0.03 + 0.24 * (index % columns), 0.86 - height * (index // columns + 1)
        axes = figure.add_axes((x, y + 0.05, 0.17 if is_list else 0.20, height - 0.055))
        axes.imshow(_indexed(item.picture).convert("RGB"), interpolation="none")
        axes.set_axis_off()
        figure.text(x, y + 0.025, f"{item.count} x", fontsize=11, weight="bold", va="center")
        figure.text(
            x + 0.031 + 0.014 * len(str(item.count)),
            y + 0.025,
            item.text,
            fontsize=7.5 if is_list else 8,
            va="center",
            linespacing=1.1,
        )
    for row, length in enumerate(page.axles):
        width = length * _MODULE_IN / 8.27
        figure.add_artist(Rectangle((0.97 - width, 0.92 - 0.05 * row), width, 0.024, facecolor="0.25", edgecolor="none"))
        figure.text(0.96 - width, 0.932 - 0.05 * row, f"{length}, 1:1", fontsize=8, ha="right", va="center")


def _html(plan: Plan, pages: Iterable[Page]) -> str:
    body = []
    for page in pages:
        parts = [f"<h2>{html.escape(page.head)}</h2>"]
        figures = "".join(
            f'<figure><img alt="" src="{_source(item.picture)}"><figcaption><b>{item.count} x</b> '
            f"{html.escape(item.text).replace(chr(10), '<br>')}</figcaption></figure>"
            for item in page.items
        )
        if figures:
            parts.append(f"<div class=items>{figures}</div>")
        if page.picture is not None:
            parts.append(_drawing(page.head, page.picture, page.cables))
        parts += [f"<p>{html.escape(line)}</p>" for line in (*page.lines, *([page.note] if page.note else []))]
        body.append(f"<section>{''.join(parts)}</section>")
    style = (
        "body{font-family:sans-serif;max-width:60em;margin:auto;padding:0 .8em}"
        "section{break-after:page;border-bottom:1px solid #ccc}"
        ".items{display:flex;flex-wrap:wrap}figure{margin:.5em}img{max-width:100%}"
    )
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(plan.title)}</title><style>{style}</style>'
    return f"{head}<body>{''.join(body)}</body></html>\n"


def _drawing(head: str, picture: Pixels, cables: tuple[Cable, ...]) -> str:
    """A picture with its cables as SVG."""
    height, width = picture.shape[:2]
    lines = []
    for cable in cables:
        (x, y), (x2, y2) = cable.ends
        lines.append(f'<path d="M{x:.0f} {y:.0f}L{x2:.0f} {y2:.0f}" stroke="{_CABLE}"/>')
        lines += [
            f'<circle cx="{x:.0f}" cy="{y:.0f}" r="9" fill="#fff" stroke="{_CABLE}"/>'
            f'<text x="{x:.0f}" y="{y + 4:.0f}" font-size="12" text-anchor="middle">{html.escape(cable.port)}</text>'
            for x, y in cable.ends
        ]
    image = f'<image width="{width}" height="{height}" href="{_source(picture)}"/>'
    return f'<svg role="img" aria-label="{html.escape(head)}" viewBox="0 0 {width} {height}">{image}{"".join(lines)}</svg>'


def _source(picture: Pixels) -> str:
    buffer = io.BytesIO()
    _indexed(picture).save(buffer, format="png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _indexed(picture: Pixels) -> Image.Image:
    """A picture with few colours, a third of the bytes."""
    return Image.fromarray(np.ascontiguousarray(picture)).quantize(_COLOURS, dither=Image.Dither.NONE)
