"""Pages of booklets: how large pictures are, what is on each page, and where it is drawn."""

from __future__ import annotations

import textwrap
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from plan_lines import BEAM, pin, plan_of

from bricktwin.plans.booklet import pages as pages_module
from bricktwin.plans.booklet import sheets
from bricktwin.plans.booklet.instructions import Instruction, Scene
from bricktwin.plans.booklet.pages import (
    DPI,
    Cable,
    Item,
    Page,
    Pages,
    _fitted,
    _step_page,
    modules_of,
    title_of,
)
from bricktwin.plans.booklet.picture import VIEWS, Picture, Shown, Studio, View, extent
from bricktwin.plans.plan import Plan

WIDE, HIGH = 8.27, 5.83
"""Of a page, inches."""
BRICK = "1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat"


class NotedStudio:
    """A studio that draws nothing, and notes how large it is to be."""

    def __init__(self) -> None:
        self.zooms: list[float] = []

    def picture(self, shown: Any, view: View, zoom: float) -> Any:
        self.zooms.append(zoom)
        return SimpleNamespace(shown=shown, view=view, zoom=zoom)


def zoom_of(line: str, inches: tuple[float, float], *largest: float) -> float:
    (placed,) = plan_of(line).parts
    studio: Any = NotedStudio()
    _fitted(studio, [Shown(placed, np.zeros(3))], View(0, 0), inches, *largest)
    return float(studio.zooms[0])


LIFE_SIZE = 0.4 / 25.4 * DPI
"""Points for an LDU of 0.4 mm."""


@pytest.mark.parametrize(
    ("inches", "is_narrow"), [((1.0, 9.0), True), ((9.0, 0.3), False), ((0.4, 5.0), True)]
)
def test_a_picture_is_as_large_as_its_place_allows(
    inches: tuple[float, float], is_narrow: bool
) -> None:
    """A brick of 80 x 24 LDU in front. Scales are 0.84 of one another, so that parts are drawn
    seldom."""
    zoom = zoom_of(BRICK, inches)
    room = inches[0] * DPI / 80.0 if is_narrow else inches[1] * DPI / 24.0
    assert 0.84 * room < zoom <= room
    steps = np.log(zoom / (1.15 * LIFE_SIZE)) / np.log(0.84)
    assert steps == pytest.approx(round(steps), abs=1e-6)


def test_a_picture_is_hardly_larger_than_the_parts() -> None:
    assert zoom_of(BRICK, (99.0, 99.0)) == pytest.approx(1.15 * LIFE_SIZE)
    # Where it is to be smaller than those, it is the next scale that is small enough.
    assert zoom_of(BRICK, (99.0, 99.0), 0.87) == pytest.approx(0.84**2 * 1.15 * LIFE_SIZE)
    assert zoom_of(BRICK, (99.0, 99.0), 1.0) == pytest.approx(0.84 * 1.15 * LIFE_SIZE)
    # What has no room at all is as small as can be.
    assert zoom_of(BRICK, (1e-6, 1e-6)) == pytest.approx(0.84**29 * 1.15 * LIFE_SIZE)


@pytest.mark.parametrize(
    ("number", "modules"),
    [
        # Axles and straight beams have lengths, bent beams and all else have none.
        ("3705", 4),
        ("3707", 8),
        ("32316", 5),
        ("32525", 11),
        ("43857", 2),
        ("32140", 0),
        ("2780", 0),
        ("3001", 0),
        ("67718", 0),
    ],
)
def test_axles_and_straight_beams_have_a_length_in_modules(number: str, modules: int) -> None:
    (placed,) = plan_of(f"1 4 0 0 0 1 0 0 0 1 0 0 0 1 {number}.dat").parts
    assert modules_of(placed) == modules


def test_a_sub_assembly_has_its_name_without_the_ending() -> None:
    assert title_of("left_front_leg.ldr") == "left front leg"
    assert title_of("wheel") == "wheel"


def pages_of(plan: Plan, monkeypatch: pytest.MonkeyPatch, steps: int = 0) -> Pages:
    """Pages whose pictures are not drawn."""
    scene = Scene((Shown(plan.parts[0], np.zeros(3)),), VIEWS[0], (), frozenset())
    step = Instruction((), frozenset(), (), 1, "", scene)
    monkeypatch.setattr(pages_module, "Studio", NotedStudio)
    monkeypatch.setattr(pages_module, "instructions", lambda plan, studio: [step] * steps)
    return Pages(plan)


@pytest.mark.parametrize(
    ("kinds", "steps", "list_pages"), [(1, 2, 1), (18, 0, 1), (19, 1, 2), (36, 1, 2), (37, 0, 3)]
)
def test_a_list_page_has_eighteen_kinds(
    monkeypatch: pytest.MonkeyPatch, kinds: int, steps: int, list_pages: int
) -> None:
    lines = [f"1 {colour} 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat" for colour in range(1, kinds + 1)]
    made = pages_of(plan_of(*lines, lines[0]), monkeypatch, steps)
    drawn = list(made)
    assert made.count == len(drawn) == 1 + list_pages + steps
    listed = drawn[1 : 1 + list_pages]
    assert [page.head for page in listed] == ["Parts"] * list_pages
    counts = [len(page.items) for page in listed]
    assert sum(counts) == kinds and max(counts) <= 18 and counts[:-1] == [18] * (list_pages - 1)
    assert sorted(item.count for page in listed for item in page.items) == [1] * (kinds - 1) + [2]
    # Steps are numbered from 1.
    assert [page.head for page in drawn[1 + list_pages :]] == [str(n + 1) for n in range(steps)]


def test_the_cover_says_how_much_there_is_to_build(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of("0 My cart", BEAM, BEAM, pin(0, -10, 20))
    cover = next(iter(pages_of(plan, monkeypatch, 3)))
    assert cover.head == "My cart"
    # Beams of 1.226 g, a pin of 0.193 g.
    assert cover.note == "3 parts of 2 kinds and colours · 3 steps · 3 g"
    listed = list(pages_of(plan, monkeypatch))[1].items
    assert [item.text.split("\n")[-2:] for item in listed] == [["32316", "red"], ["2780", "black"]]


def test_pictures_of_a_step_leave_room_for_its_bars_and_its_note(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rooms: list[tuple[tuple[float, float], tuple[float, ...]]] = []

    def fitted(studio: Any, shown: Any, view: Any, inches: Any, *largest: float) -> Any:
        rooms.append((inches, largest))
        return SimpleNamespace()

    monkeypatch.setattr(pages_module, "_fitted", fitted)
    plan = plan_of(BEAM, pin(0, -10, 20), "1 0 0 0 0 1 0 0 0 1 0 0 0 1 3705.dat")
    scene = Scene((), VIEWS[0], (), frozenset())
    moves: Any = (SimpleNamespace(items=((0,), (1,), (2,))),)
    studio: Any = None
    step = Instruction(moves, frozenset(), (), 1, "", scene)
    page = _step_page(plan, studio, step, 7)
    assert page.head == "7" and [item.text for item in page.items] == [
        plan.parts[part].part.name for part in range(3)
    ]
    assert [item.bar is not None for item in page.items] == [True, False, True]
    assert rooms[:3] == [((1.5, 0.62), (0.87,))] * 3
    # Two bars of 0.36 inches.
    assert rooms[3] == ((5.7, pytest.approx(4.7 - 0.72)), ())
    assert len(rooms) == 4 and page.inset is None
    with_note = Instruction(moves, frozenset(), (), 1, "Mind the pin.", scene, inset=scene)
    page = _step_page(plan, studio, with_note, 8)
    assert page.note == "Mind the pin." and page.inset is not None
    assert rooms[7][0] == (5.7, pytest.approx(4.7 - 0.72 - 0.25))
    assert rooms[8][0] == (1.7, 1.5)


def test_cables_are_told_in_the_order_of_their_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    motor = "1 15 {} 0 200 1 0 0 0 1 0 0 0 1 54696p02.dat"
    lines = ["1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat"]
    for port, x in (("D", 0), ("A", 100), ("F", -100)):
        lines += [f"0 !BRICKSRL PORT {port}", motor.format(x)]
    made = pages_of(plan_of(*lines), monkeypatch)
    page = list(made)[-1]
    assert made.count == 3 and page.head == "Cables"
    assert [cable.port for cable in page.cables] == ["A", "D", "F"]
    assert [line[:6] for line in page.lines] == ["Port A", "Port D", "Port F"]
    # Without a name there is none between quotes.
    assert page.lines[0].startswith("Port A: Medium angular motor, ")
    # Seen from the side where the ports are, with a line of text for each below it.
    view = VIEWS[3]
    shown = [Shown(part, np.zeros(3)) for part in made._plan.parts]
    width, height = extent(shown, view)
    zoom = page.picture.zoom  # type: ignore[union-attr]
    room = min(7.6 * DPI / width, (4.55 - 3 * 0.22) * DPI / height)
    assert 0.84 * room < zoom <= room or zoom == pytest.approx(1.15 * LIFE_SIZE)
    assert page.picture.view == view  # type: ignore[union-attr]


# ---------------------------------------------------------------- sheets

PLAN = plan_of(BEAM, pin(0, -10, 20))
PICTURE: Picture = Studio().picture(
    [Shown(placed, np.zeros(3)) for placed in PLAN.parts], VIEWS[0], 1.0
)


def step_with(**values: Any) -> Instruction:
    arrow = (np.array([0.0, -60.0, 20.0]), np.array([0.0, -10.0, 20.0]))
    scene = Scene((), VIEWS[0], (arrow,), frozenset({1}))
    defaults = {"moves": (), "before": frozenset(), "assembly": (), "times": 1, "note": ""}
    return Instruction(**{**defaults, "scene": scene, **values})


def texts_of(figure: Figure) -> dict[str, Any]:
    return {text.get_text(): text for text in figure.texts}


def inches(text: Any) -> tuple[float, float]:
    x, y = text.get_position()
    return x * WIDE, y * HIGH


def places(figure: Figure) -> list[Any]:
    """Left, bottom, right and top of each picture, inches."""
    found = []
    for axes in figure.axes:
        box = axes.get_position()
        found.append((box.x0 * WIDE, box.y0 * HIGH, box.x1 * WIDE, box.y1 * HIGH))
    return found


def middle(box: Any) -> Any:
    return pytest.approx(((box[0] + box[2]) / 2, (box[1] + box[3]) / 2))


def test_a_page_is_half_of_a_sheet_of_a4() -> None:
    figure = sheets._figure(Page("Cover", "", PICTURE), 1)
    assert [25.4 * side for side in figure.get_size_inches()] == pytest.approx([210, 148], abs=0.2)
    assert figure.dpi == DPI


def test_head_note_and_number_are_in_the_corners_of_a_page() -> None:
    figure = sheets._figure(Page("12", "A note.", PICTURE, (), step_with()), 34)
    texts = texts_of(figure)
    assert inches(texts["12"]) == pytest.approx((0.32, HIGH - 0.48))
    assert inches(texts["A note."]) == pytest.approx((0.32, 0.3))
    # The number ends at its place, so that it is not cut off.
    assert inches(texts["34"]) == pytest.approx((WIDE - 0.28, 0.3))
    assert texts["34"].get_ha() == "right" and texts["12"].get_ha() == "left"
    assert texts["12"].get_weight() == "bold" and texts["34"].get_weight() == "normal"
    # All stand in the middle of their line, the number of a step as the largest.
    assert {text.get_va() for text in texts.values()} == {"center"}
    sizes = {name: texts[name].get_fontsize() for name in ("12", "A note.", "34")}
    assert sizes == {"12": 30, "A note.": 9, "34": 8}
    # A title has many letters.
    title = sheets._figure(Page("My long title", "", PICTURE), 1)
    assert texts_of(title)["My long title"].get_fontsize() == 22


def test_a_long_note_is_broken_into_lines() -> None:
    note = "word " * 40
    figure = sheets._figure(Page("1", note, PICTURE, (), step_with()), 1)
    (text,) = (name for name in texts_of(figure) if name.startswith("word"))
    rows = text.split("\n")
    assert rows == textwrap.wrap(note, 112) and len(rows) == 2
    assert max(map(len, rows)) > 100


@pytest.mark.parametrize(
    ("bars", "note", "floor"),
    [(0, "", 0.5), (2, "", 0.5 + 0.72), (1, "word " * 40, 0.5 + 0.36 + 0.2), (0, "short", 0.5)],
)
def test_the_picture_of_a_step_is_beside_its_items_and_above_its_bars(
    bars: int, note: str, floor: float
) -> None:
    items = tuple(Item(PICTURE, 1, f"bar {number}", PLAN.parts[0]) for number in range(bars))
    figure = sheets._figure(Page("1", note, PICTURE, items, step_with()), 1)
    boxes = places(figure)
    # The column ends at 2.13 inches, and above the picture is the line of the head.
    assert pytest.approx((boxes[bars][0] + boxes[bars][2]) / 2) == (2.3 + WIDE - 0.3) / 2
    assert (floor + HIGH - 0.8) / 2 == pytest.approx((boxes[bars][1] + boxes[bars][3]) / 2)
    # Bars lie one above the other, the first one on top.
    lengths = [text for text in figure.texts if text.get_text().endswith("1:1")]
    rows = [inches(text)[1] for text in lengths]
    assert rows == pytest.approx([0.62 + 0.36 * row for row in range(bars)])


def test_the_first_bar_is_on_top() -> None:
    long, short = plan_of("1 0 0 0 0 1 0 0 0 1 0 0 0 1 3707.dat", BEAM).parts
    items = (Item(PICTURE, 1, "axle", long), Item(PICTURE, 1, "pin"), Item(PICTURE, 1, "", short))
    figure = sheets._figure(Page("1", "", PICTURE, items, step_with()), 1)
    texts = texts_of(figure)
    assert inches(texts["8   1:1"])[1] == pytest.approx(0.98)
    assert inches(texts["5   1:1"])[1] == pytest.approx(0.62)


def test_a_step_has_a_compass_and_says_when_its_view_is_turned() -> None:
    for is_turned in (False, True):
        step = step_with(is_turned=is_turned)
        figure = sheets._figure(Page("1", "", PICTURE, (), step), 1)
        texts = texts_of(figure)
        assert ("from the front, left" in texts) is is_turned
        tips = [
            patch._posA_posB[0] for patch in figure.artists if isinstance(patch, FancyArrowPatch)
        ]
        # Both arrows of the compass begin at its middle, in the upper right corner.
        assert tips.count((WIDE - 0.85, HIGH - 0.5)) == 4
        if is_turned:
            assert inches(texts["from the front, left"]) == pytest.approx((WIDE - 2.7, HIGH - 0.66))
            # Two arrows in a circle: one to the right below, one back above.
            turns = [
                patch._posA_posB
                for patch in figure.artists
                if isinstance(patch, FancyArrowPatch)
                and abs(patch._posA_posB[0][0] - WIDE + 2.7) < 0.2
            ][::2]
            (start, end), (back, over) = turns
            assert np.subtract(end, start) == pytest.approx((0.32, 0.0))
            assert np.subtract(over, back) == pytest.approx((-0.32, 0.0))
            assert back[1] - start[1] == pytest.approx(0.1)


def test_an_arrow_of_a_step_goes_to_where_the_part_belongs() -> None:
    step = step_with()
    figure = sheets._figure(Page("1", "", PICTURE, (), step), 1)
    (box,) = places(figure)
    first = next(patch for patch in figure.artists if isinstance(patch, FancyArrowPatch))
    for end, place in zip(first._posA_posB, step.scene.arrows[0], strict=True):
        x, y = PICTURE.pixel_of(place)
        assert end == pytest.approx((box[0] + x / DPI, box[3] - y / DPI))


def test_an_inset_is_drawn_above_the_picture() -> None:
    step = step_with(inset=step_with().scene)
    figure = sheets._figure(Page("1", "", PICTURE, (), step, PICTURE), 1)
    large, small = figure.axes
    assert small.get_zorder() > large.get_zorder()
    (inset,) = [box for box in figure.artists if isinstance(box, FancyBboxPatch)][-1:]
    assert large.get_zorder() < inset.get_zorder() < small.get_zorder()
    # Without a picture of it, or without its scene, there is none.
    for page in (
        Page("1", "", PICTURE, (), step_with(), PICTURE),
        Page("1", "", PICTURE, (), step, None),
    ):
        assert len(sheets._figure(page, 1).axes) == 1


def test_items_lie_on_their_box_and_texts_on_all() -> None:
    item = Item(PICTURE, 2, "beam")
    figure = sheets._figure(Page("1", "", PICTURE, (item,), step_with()), 1)
    (box,) = [patch for patch in figure.artists if isinstance(patch, FancyBboxPatch)]
    picture = figure.axes[0]
    count = texts_of(figure)["2x"]
    assert box.get_zorder() < picture.get_zorder() <= count.get_zorder()
    # A line is a little higher than its letters, so that two of them do not touch.
    assert count._linespacing == 1.15
    # The large picture comes later, and its arrows last.
    arrows = [patch for patch in figure.artists if isinstance(patch, FancyArrowPatch)]
    assert min(arrow.get_zorder() for arrow in arrows) >= figure.axes[1].get_zorder()


def test_a_cover_has_its_picture_in_the_middle_and_lines_below_it() -> None:
    lines = ("Port A: a", "Port B: b")
    end = (np.array([0.0, -10.0, 20.0]), np.array([0.0, 0.0, -40.0]))
    cables = (Cable("A", lines[0], end),)
    figure = sheets._figure(Page("Cables", "", PICTURE, lines=lines, cables=cables), 9)
    texts = texts_of(figure)
    # The first line is on top.
    assert inches(texts["Port A: a"]) == pytest.approx((0.4, 0.82))
    assert inches(texts["Port B: b"]) == pytest.approx((0.4, 0.6))
    (box,) = places(figure)
    floor = 0.55 + 0.44
    assert (WIDE / 2, (floor + HIGH - 0.75) / 2) == middle(box)
    # Both ends of a cable have its letter.
    letters = sorted(inches(text) for text in figure.texts if text.get_text() == "A")
    expected = []
    for place in end:
        x, y = PICTURE.pixel_of(place)
        expected.append((box[0] + x / DPI, box[3] - y / DPI))
    assert letters == [pytest.approx(place) for place in sorted(expected)]
    tips = [patch._posA_posB[0] for patch in figure.artists if isinstance(patch, FancyArrowPatch)]
    assert tips.count((WIDE - 0.85, floor + 0.3)) == 4


def test_a_page_of_the_list_has_no_picture_of_the_robot() -> None:
    items = tuple(Item(PICTURE, number, f"part {number}") for number in (1, 2))
    figure = sheets._figure(Page("Parts", "", items=items), 2)
    assert len(figure.axes) == 2 and {"1x", "2x", "part 1", "part 2"} <= set(texts_of(figure))


@pytest.mark.parametrize(
    ("assembly", "times", "title"),
    [
        ((), 1, None),
        (("leg.ldr:3",), 1, "leg"),
        (("leg.ldr:3", "left_foot.ldr:9"), 2, "left foot  ·  build it 2 times"),
    ],
)
def test_a_page_of_a_sub_assembly_has_a_frame_and_a_title(
    assembly: tuple[str, ...], times: int, title: str | None
) -> None:
    step = step_with(assembly=assembly, times=times)
    figure = sheets._figure(Page("1", "", PICTURE, (), step), 1)
    frames = [patch for patch in figure.artists if isinstance(patch, FancyBboxPatch)]
    wide = [frame for frame in frames if frame.get_width() > 7.0]
    assert len(wide) == (title is not None)
    if title is not None:
        (frame,) = wide
        assert (frame.get_x(), frame.get_y()) == (0.12, 0.12)
        assert frame.get_width() == pytest.approx(WIDE - 0.24)
        assert frame.get_height() == pytest.approx(HIGH - 0.24)
        text = texts_of(figure)[title]
        assert inches(text) == pytest.approx((2.35, HIGH - 0.38))
        assert text.get_weight() == "bold" and text.get_fontsize() == 12
