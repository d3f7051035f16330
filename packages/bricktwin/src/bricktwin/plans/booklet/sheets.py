"""Sheets of a booklet: each page drawn, in a PDF or an HTML file."""

from __future__ import annotations

import base64
import html
import io
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from brickhub.errors import PlanError
from brickhub.files import check_writable, write_durably
from bricktwin.drawing import import_matplotlib
from bricktwin.plans.booklet.committed import digest_of
from bricktwin.plans.booklet.instructions import Instruction, Scene
from bricktwin.plans.booklet.pages import (
    DPI,
    LIST_COLUMNS,
    MM_PER_INCH,
    Cable,
    Item,
    Page,
    Pages,
    modules_of,
    title_of,
)
from bricktwin.plans.booklet.picture import Picture, View
from bricktwin.plans.geometry import Floats
from bricktwin.plans.part import Fit
from bricktwin.plans.plan import Placed, Plan

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

FORMATS = (".pdf", ".html")
# A page is half of an A4 sheet, in landscape; sizes are in inches.
_WIDTH = 8.27
_HEIGHT = 5.83
_COLOURS = 128
"""Colours of a picture, and of a page in HTML."""
_HTML_DPI = 150
_NOTE_WIDTH = 112
"""Characters per line of a note."""
_ARROW = "#d9480f"
_CABLE = "#c2410c"
_PAPER = (1.0, 1.0, 1.0)
"""Colour of pages."""
_BOX = (0.886, 0.933, 0.969)
"""Colour of boxes with parts."""
_BOX_EDGE = "#7a9bb8"
_SUB_ASSEMBLY = (1.0, 0.965, 0.843)
"""Colour of pages of sub-assemblies."""
_COMPASS = 0.42
"""Length of the compass's arrows where they are seen from the side, inches."""
# Bars are drawn in the sizes of real parts, so that a part can be laid on the page and compared.
_BEAM_WIDTH_MM = 7.2
_AXLE_WIDTH_MM = 4.6
_HOLE_RADIUS_MM = 2.4
_MODULE_MM = 8.0
OnPage = Callable[[int, int], None]
"""What is told of each page that is done: its number, and how many there are; both are 0 at the
beginning, while the steps are sought."""


def write_booklet(
    plan: Plan,
    path: Path,
    on_page: OnPage = lambda *_: None,
) -> int:
    """Write the booklet. Returns the number of pages. Raises PlanError if the suffix is not
    ``.pdf`` or ``.html``, or the plan has no parts."""
    if path.suffix.lower() not in FORMATS:
        raise PlanError(f"{path}: a booklet is a .pdf or .html file; name one of these")
    if not plan.parts:
        raise PlanError(
            f"{plan.path} has no part that the catalogue knows; run `bricktwin plan check` on it"
        )
    check_writable(path)
    write = _pdf if path.suffix.lower() == ".pdf" else _html
    on_page(0, 0)
    pages = Pages(plan)
    data = write(plan, _told(pages, on_page))
    write_durably(path, data)
    return pages.count


def _told(pages: Pages, on_page: OnPage) -> Iterator[Page]:
    """The pages, of each of which is told when the next one is asked for: when it is drawn."""
    for number, page in enumerate(pages, 1):
        yield page
        on_page(number, pages.count)


def _pdf(plan: Plan, pages: Iterable[Page]) -> bytes:
    """The booklet. Pages are drawn one after the other, because their pictures are large."""
    import_matplotlib()
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import PdfPages

    # Names of parts and robots may contain a dollar sign, which Matplotlib would take for a
    # formula.
    # Pictures keep their points.
    style: Any = {"text.parse_math": False, "image.interpolation": "none"}
    buffer = io.BytesIO()
    # The file has no date, so that the same plan makes the same bytes.
    metadata = {
        "Title": plan.title,
        "Creator": "BricksRL",
        "Keywords": digest_of(Path(plan.path)),
        "CreationDate": None,
    }
    with rc_context(style), PdfPages(buffer, metadata=metadata) as pdf:
        for number, page in enumerate(pages, 1):
            pdf.savefig(_figure(page, number))
    return buffer.getvalue()


def _html(plan: Plan, pages: Iterable[Page]) -> bytes:
    """The same pages as pictures, with their text for those who cannot see them."""
    import_matplotlib()
    from matplotlib import rc_context

    body = []
    for number, page in enumerate(pages, 1):
        buffer = io.BytesIO()
        png = io.BytesIO()
        with rc_context({"text.parse_math": False, "image.interpolation": "antialiased"}):
            _figure(page, number).savefig(buffer, format="png", dpi=_HTML_DPI)
        # Few colours are enough for a drawing, and make the file a third as large.
        image = Image.open(buffer).convert("RGB")
        image = image.quantize(_COLOURS, dither=Image.Dither.NONE)
        image.save(png, format="png", optimize=True)
        item_texts = [f"{item.count} x {item.text}" for item in page.items]
        texts = [page.head, *item_texts, *page.lines, page.note]
        description = html.escape(". ".join(text for text in texts if text))
        source = f"data:image/png;base64,{base64.b64encode(png.getvalue()).decode()}"
        body.append(f'<section><img alt="{description}" src="{source}"></section>')
    style = (
        "body{margin:auto;max-width:80em}section{break-after:page;border-bottom:1px solid "
        "#ccc}img{width:100%}"
    )
    head = (
        '<!doctype html><html lang="en"><meta '
        f'charset="utf-8"><title>{html.escape(plan.title)}</title><style>{style}</style>'
    )
    # The pictures are inside of the page, so that it is one file which can be sent on and opened
    # anywhere.
    return f"{head}<body>{''.join(body)}</body></html>\n".encode()


def _figure(page: Page, number: int) -> Figure:
    """Draw a page."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=DPI)
    step = page.instruction
    paper = _SUB_ASSEMBLY if step is not None and step.assembly else _PAPER
    if step is not None and step.assembly:
        _box(
            figure,
            (0.12, 0.12, _WIDTH - 0.24, _HEIGHT - 0.24),
            paper,
            "#b08900",
        )
        title = title_of(step.assembly[-1].rpartition(":")[0])
        if step.times > 1:
            title += f"  ·  build it {step.times} times"
        _text(
            figure,
            2.35,
            _HEIGHT - 0.38,
            title,
            12,
            weight="bold",
        )
    _text(
        figure,
        0.32,
        _HEIGHT - 0.48,
        page.head,
        30 if step else 22,
        weight="bold",
    )
    _text(
        figure,
        _WIDTH - 0.28,
        0.3,
        f"{number}",
        8,
        ha="right",
        color="0.45",
    )
    note = textwrap.fill(page.note, _NOTE_WIDTH)
    _text(figure, 0.32, 0.3, note, 9)
    if step is None and page.items:
        _part_list(figure, page.items)
    elif step is not None:
        bars = [item.bar for item in page.items if item.bar is not None]
        floor = 0.5 + 0.36 * len(bars) + (0.2 if "\n" in note else 0.0)
        _item_column(figure, page.items)
        for row, bar in enumerate(reversed(bars)):
            _life_size(figure, bar, 0.62 + 0.36 * row)
        _scene(figure, page, step, floor, paper)
    if page.picture is not None and step is None:
        floor = 0.55 + 0.22 * len(page.lines)
        middle = (_WIDTH / 2, floor + (_HEIGHT - 0.75 - floor) / 2)
        corner = _put(
            figure,
            page.picture,
            None,
            _PAPER,
            middle,
        )
        _compass(figure, page.picture.view, (_WIDTH - 0.85, floor + 0.3))
        for row, line in enumerate(reversed(page.lines)):
            _text(
                figure,
                0.4,
                0.6 + 0.22 * row,
                line,
                9,
            )
        for cable in page.cables:
            _cable(figure, page.picture, corner, cable)
    return figure


def _scene(
    figure: Figure,
    page: Page,
    step: Instruction,
    floor: float,
    paper: tuple[float, float, float],
) -> None:
    """The picture of a step with its arrows, the inset, the compass and the mark of a turned
    view."""
    assert page.picture is not None  # noqa: S101
    middle = (2.3 + (_WIDTH - 2.3 - 0.3) / 2, floor + (_HEIGHT - 0.8 - floor) / 2)
    corner = _put(
        figure,
        page.picture,
        set(step.scene.bright),
        paper,
        middle,
    )
    _arrows(
        figure,
        page.picture,
        corner,
        step.scene,
    )
    # The inset is drawn after the picture, as all that lies over it.
    if page.inset is not None and step.inset is not None:
        _inset(
            figure,
            page.inset,
            step.inset,
            floor,
        )
    _compass(figure, step.scene.view, (_WIDTH - 0.85, _HEIGHT - 0.5))
    if step.is_turned:
        _turn_mark(figure, step.scene.view, (_WIDTH - 2.7, _HEIGHT - 0.36))


def _inset(
    figure: Figure,
    picture: Picture,
    scene: Scene,
    floor: float,
) -> None:
    """Draw a small picture of the parts that the large one hides, in a box at the lower right,
    above ``floor``."""
    width, height = (side / DPI for side in picture.size)
    left = _WIDTH - 0.45 - width
    bottom = floor + 0.15
    _box(
        figure,
        (left - 0.1, bottom - 0.1, width + 0.2, height + 0.2),
        _PAPER,
        "0.35",
    )
    middle = (left + width / 2, bottom + height / 2)
    corner = _put(
        figure,
        picture,
        set(scene.bright),
        _PAPER,
        middle,
    )
    _arrows(figure, picture, corner, scene)


def _text(
    figure: Figure,
    x: float,
    y: float,
    text: str,
    size: float,
    **style: Any,
) -> None:
    """Text at a position in inches."""
    # Matplotlib draws all texts after all lines and boxes, so the order of drawing is given to
    # each.
    above = len(figure.get_children())
    figure.text(
        x / _WIDTH,
        y / _HEIGHT,
        text,
        fontsize=size,
        zorder=above,
        linespacing=1.15,
        **{"va": "center", **style},
    )


def _box(
    figure: Figure,
    rectangle: tuple[float, float, float, float],
    face: tuple[float, float, float],
    edge: str,
) -> None:
    """A box with round corners: left, bottom, width, height in inches."""
    from matplotlib.patches import FancyBboxPatch

    left, bottom, width, height = rectangle
    style = "round,pad=0,rounding_size=0.09"
    patch = FancyBboxPatch(
        (left, bottom),
        width,
        height,
        style,
        facecolor=face,
        edgecolor=edge,
        linewidth=0.8,
    )
    _add(figure, patch)


def _add(figure: Figure, artist: Artist) -> None:
    """Add an artist in inches, above all that is there."""
    artist.set_transform(figure.dpi_scale_trans)
    artist.set_zorder(len(figure.get_children()))
    figure.add_artist(artist)


def _line(
    figure: Figure,
    points: Sequence[tuple[float, float]],
    colour: str,
    width: float,
) -> None:
    """A line through points in inches."""
    from matplotlib.lines import Line2D

    x, y = zip(*points, strict=True)
    _add(figure, Line2D(x, y, color=colour, linewidth=width))


def _arrow(
    figure: Figure,
    start: tuple[float, float],
    end: tuple[float, float],
    colour: str,
    width: float,
    bend: float = 0,
    style: str = "-",
) -> None:
    """An arrow between points in inches."""
    from matplotlib.patches import FancyArrowPatch

    # A wider white line under the arrow keeps it apart from the parts behind it.
    for edge, line in (("white", width + 1.6), (colour, width)):
        patch = FancyArrowPatch(
            start,
            end,
            arrowstyle="-|>",
            mutation_scale=4.5 * width,
            connectionstyle=f"arc3,rad={bend}",
            color=edge,
            linewidth=line,
            linestyle=style,
            shrinkA=0,
            shrinkB=0,
        )
        _add(figure, patch)


def _put(
    figure: Figure,
    picture: Picture,
    bright: set[int] | None,
    paper: tuple[float, float, float],
    middle: tuple[float, float],
) -> tuple[float, float]:
    """Put a picture's middle somewhere, in inches. Returns its upper left corner."""
    width, height = (side / DPI for side in picture.size)
    left = middle[0] - width / 2
    top = middle[1] + height / 2
    # Matplotlib counts in shares of the page, from its lower left corner, so inches are converted.
    bottom = top - height
    axes = figure.add_axes((left / _WIDTH, bottom / _HEIGHT, width / _WIDTH, height / _HEIGHT))
    axes.set_zorder(len(figure.get_children()))
    axes.imshow(picture.pixels(bright, paper, _COLOURS), aspect="auto")
    axes.set_axis_off()
    return left, top


def _inches(
    picture: Picture,
    corner: tuple[float, float],
    point: Floats,
) -> tuple[float, float]:
    """Place of a point [3] of the plan on the page, inches."""
    x, y = picture.pixel_of(point)
    return corner[0] + x / DPI, corner[1] - y / DPI


def _cable(
    figure: Figure,
    picture: Picture,
    corner: tuple[float, float],
    cable: Cable,
) -> None:
    """A cable with the letter of its port at both ends."""
    ends = [_inches(picture, corner, end) for end in cable.ends]
    _line(figure, ends, "white", 3.0)
    _line(figure, ends, _CABLE, 1.4)
    badge = {
        "boxstyle": "circle,pad=0.2",
        "facecolor": "white",
        "edgecolor": _CABLE,
        "linewidth": 0.9,
    }
    for x, y in ends:
        _text(
            figure,
            x,
            y,
            cable.port,
            7,
            weight="bold",
            ha="center",
            bbox=badge,
        )


def _arrows(
    figure: Figure,
    picture: Picture,
    corner: tuple[float, float],
    scene: Scene,
) -> None:
    """The arrows of a scene: dashed and grey where they run behind parts."""
    for start, end in scene.arrows:
        # The last tenth is left out, because it lies on the part where the arrow ends.
        points = [start + (end - start) * share for share in np.linspace(0.0, 0.9, 7)]
        hidden_share = np.mean([picture.hides(point) for point in points])
        tail = _inches(picture, corner, start)
        tip = _inches(picture, corner, end)
        if hidden_share > 0.5:
            _arrow(
                figure,
                tail,
                tip,
                "0.4",
                0.9,
                style="--",
            )
        else:
            _arrow(figure, tail, tip, _ARROW, 1.6)


def _compass(
    figure: Figure,
    view: View,
    middle: tuple[float, float],
) -> None:
    """Draw the robot's front and right in a view, which are z and x in a plan."""
    centre = np.array(middle)
    # The y axis is turned round, because it points down in a picture and up on a page.
    to_page = np.array([_COMPASS, -_COMPASS])
    right, front = ((view.axes[:2] @ np.eye(3)[axis]) * to_page for axis in (0, 2))  # [2] each
    # Without this square in the plane of the two arrows, nothing would show that they lie flat.
    corners = [
        centre + (across * right + along * front) * 0.45
        for across, along in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    ]
    _line(
        figure,
        [(float(x), float(y)) for x, y in corners],
        "0.6",
        0.8,
    )
    for direction, name, colour in ((right, "right", "#1864ab"), (front, "front", "0.3")):
        tip_x, tip_y = (centre + direction).tolist()
        _arrow(
            figure,
            middle,
            (tip_x, tip_y),
            colour,
            1.2,
        )
        # The label stands beyond the tip, because on the arrow's head it could not be read.
        clearance = np.array([0.03 * np.sign(direction[0]), 0.05 * np.sign(direction[1])])
        x, y = (centre + direction * 1.12 + clearance).tolist()
        align = "left" if direction[0] > 0 else "right"
        _text(
            figure,
            x,
            y,
            name,
            7,
            ha=align,
            color=colour,
            weight="bold",
        )


def _turn_mark(
    figure: Figure,
    view: View,
    middle: tuple[float, float],
) -> None:
    """Draw two arrows in a circle, and write from where the robot is seen now."""
    x, y = middle
    _arrow(
        figure,
        (x - 0.16, y - 0.05),
        (x + 0.16, y - 0.05),
        "0.2",
        1.4,
        0.6,
    )
    _arrow(
        figure,
        (x + 0.16, y + 0.05),
        (x - 0.16, y + 0.05),
        "0.2",
        1.4,
        0.6,
    )
    words = [
        "from behind" if abs(view.turn_deg) > 90 else "from the front",
        "left" if view.turn_deg > 0 else "right",
    ]
    # Most views are from above, so only a view from below is named.
    if view.tilt_deg < 0:
        words.append("below")
    _text(
        figure,
        x,
        y - 0.3,
        ", ".join(words),
        7,
        ha="center",
        color="0.2",
    )


def _item_column(figure: Figure, items: Sequence[Item]) -> None:
    """The box with the items of a step."""
    row_height = 0.98
    top = _HEIGHT - 0.85
    bottom = top - row_height * len(items) - 0.06
    height = row_height * len(items) + 0.06
    _box(
        figure,
        (0.28, bottom, 1.85, height),
        _BOX,
        _BOX_EDGE,
    )
    for row, item in enumerate(items):
        y = top - row_height * (row + 1)
        _put(
            figure,
            item.picture,
            None,
            _BOX,
            (1.2, y + 0.6),
        )
        _text(
            figure,
            0.4,
            y + 0.13,
            f"{item.count}x",
            11,
            weight="bold",
        )
        # The name is moved to the right by the digits of the count.
        name_x = 0.55 + 0.1 * len(str(item.count))
        _text(
            figure,
            name_x,
            y + 0.13,
            textwrap.shorten(item.text, 27),
            7.5,
        )


def _part_list(figure: Figure, items: Sequence[Item]) -> None:
    """A page of the list of parts: a box for each kind and colour, row by row."""
    width = (_WIDTH - 0.6) / LIST_COLUMNS
    height = 1.6
    for index, item in enumerate(items):
        row, column = divmod(index, LIST_COLUMNS)
        x = 0.32 + width * column
        y = _HEIGHT - 0.8 - height * (row + 1)
        _box(
            figure,
            (x, y + 0.04, width - 0.1, height - 0.1),
            _BOX,
            _BOX_EDGE,
        )
        _put(
            figure,
            item.picture,
            None,
            _BOX,
            (x + width / 2 - 0.05, y + 1.0),
        )
        _text(
            figure,
            x + 0.08,
            y + height - 0.2,
            f"{item.count}x",
            12,
            weight="bold",
        )
        _text(
            figure,
            x + 0.08,
            y + 0.1,
            item.text,
            7,
            va="bottom",
        )


def _life_size(
    figure: Figure,
    placed: Placed,
    y: float,
) -> None:
    """Draw an axle or a straight beam in its real length, with marks at its modules."""
    from matplotlib.patches import Circle

    modules = modules_of(placed)
    is_axle = placed.part.family == "axles"
    has_holes = any(site.fit is Fit.HOLE for site in placed.part.sites)
    # The bar is drawn in life size, so its millimetres become the inches of the page.
    width = (_AXLE_WIDTH_MM if is_axle else _BEAM_WIDTH_MM) / MM_PER_INCH
    length = modules * _MODULE_MM / MM_PER_INCH
    pitch = _MODULE_MM / MM_PER_INCH
    # The bar stands beside the column of items. A long one goes below it, because it cannot be
    # scaled down.
    left = 2.35
    if left + length > _WIDTH - 0.3:
        left = 0.3
    _box(
        figure,
        (left, y - width / 2, length, width),
        (0.93, 0.93, 0.93),
        "0.2",
    )
    for module in range(modules):
        # The bar has the marks of the real part, by which a reader counts its modules: an axle has
        # them between its modules, and a beam has a hole in the middle of each.
        if is_axle and module:
            x = left + module * pitch
            _line(
                figure,
                [(x, y - width / 2), (x, y + width / 2)],
                "0.55",
                0.6,
            )
        elif not is_axle and has_holes:
            hole = Circle(
                (left + (module + 0.5) * pitch, y),
                _HOLE_RADIUS_MM / MM_PER_INCH,
                facecolor="white",
                edgecolor="0.2",
                linewidth=0.7,
            )
            _add(figure, hole)
    _text(
        figure,
        left + length + 0.08,
        y,
        f"{modules}   1:1",
        8,
        weight="bold",
    )
