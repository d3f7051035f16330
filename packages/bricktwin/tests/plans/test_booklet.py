"""Pictures and booklets."""

from __future__ import annotations

import itertools
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch
from plan_lines import BEAM, PLANS, pin, plan_of, solid_volume

from brickhub.errors import PlanError
from bricktwin.plans import catalogue
from bricktwin.plans.booklet import sheets
from bricktwin.plans.booklet.committed import committed_booklet
from bricktwin.plans.booklet.instructions import (
    MAX_KINDS,
    MAX_PIECES,
    MIN_VISIBLE,
    Instruction,
    Scene,
    _Author,
    instructions,
    kind_of,
)
from bricktwin.plans.booklet.pages import DPI, Item, Page, Pages, modules_of
from bricktwin.plans.booklet.picture import (
    VIEWS,
    Shown,
    Studio,
    View,
    _look,
    _Palette,
    extent,
    sprite_of,
)
from bricktwin.plans.booklet.sheets import write_booklet
from bricktwin.plans.booklet.sprite import _lines
from bricktwin.plans.building import Occupancy
from bricktwin.plans.drawing.looks import TINTS, Tint, look_of
from bricktwin.plans.drawing.meshes import surface_of
from bricktwin.plans.plan import read_plan

WHITE = (1.0, 1.0, 1.0)
WHEEL = (
    "0 FILE wheel.ldr\n1 71 0 0 0 1 0 0 0 1 0 0 0 1 39367p02.dat\n0 STEP\n"
    "1 71 0 0 20 1 0 0 0 1 0 0 0 1 3713.dat"
)


@pytest.fixture
def coarse(monkeypatch):
    """Pages of few pixels; `test_two_wheeler_booklet` has all of them."""
    monkeypatch.setattr("bricktwin.plans.booklet.pages.DPI", 60)
    monkeypatch.setattr("bricktwin.plans.booklet.sheets._HTML_DPI", 20)


def picture_of(plan, view=VIEWS[0], zoom=1.0):
    return Studio().picture([Shown(placed, np.zeros(3)) for placed in plan.parts], view, zoom)


def steps_of(*lines):
    return list(instructions(plan_of(*lines), Studio()))


def test_all_materials_are_grey_but_two():
    """The teal of hubs and the warm light of lamps."""
    spread = {tint: max(colour) - min(colour) for tint, colour in TINTS.items()}
    assert {tint for tint in spread if spread[tint] > 0.1} == {Tint.TEAL, Tint.LIT}
    assert all(0.0 <= value <= 1.0 for colour in TINTS.values() for value in colour)


def test_every_part_is_drawn_at_its_size():
    for part in catalogue.parts():
        points = np.concatenate([piece.solid.corners() for piece in look_of(part)])
        low, high = part.bounds
        is_cable = part.device is not None and part.device.cable_mm > 0
        limit = 20.0 if is_cable else 4.6
        assert np.abs(points.min(axis=0) - low).max() < limit, part.number
        assert np.abs(points.max(axis=0) - high).max() < limit, part.number


def test_surfaces_face_outwards():
    for part in catalogue.parts():
        triangles = surface_of(part).triangles
        volume = (
            float(
                np.einsum(
                    "ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])
                ).sum()
            )
            / 6
        )
        full = solid_volume(part)
        # Solids overlap one another, and holes are discs on their surface.
        assert 0.3 * full < volume < 4.0 * full, part.number


def test_every_part_has_a_picture():
    for part, view in zip(catalogue.parts(), itertools.cycle(VIEWS), strict=False):
        sprite = sprite_of(part, view.axes, 0.4)
        assert sprite.count > 0, part.number
        assert sprite.coat[sprite.source >= 0].all()


def test_default_view_is_upright_from_front_left():
    right, down, away = VIEWS[0].axes
    assert np.allclose(np.stack([right, down, away]) @ np.stack([right, down, away]).T, np.eye(3))
    assert np.allclose(np.cross(right, down), away)
    assert right[1] == pytest.approx(0)
    assert down[1] > 0  # a plan's y points down
    assert away[1] > 0  # from above, one looks down
    assert away[2] < 0  # from the front, one looks backwards


def test_box_covers_its_projection():
    plan = plan_of("1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat")  # 80 x 24, with studs of 4
    picture = picture_of(plan, View(0, 0), 4.0)
    assert (picture.owner == 0).sum() == pytest.approx((80 * 24 + 4 * 12 * 4) * 16, rel=0.03)


def test_a_line_is_where_the_surface_folds_or_jumps():
    """Two faces at a right angle, side by side, and nothing to the right of them."""
    depth = np.array([[0.0, 0.0, 0.0, 0.0, np.inf], [9.0, 9.0, 9.0, 9.0, np.inf]])
    faces = np.array([[0, 0, 1, 1, -1]] * 2)
    normals = np.zeros((2, 5, 3))
    normals[:, :2, 2] = normals[:, 2:4, 0] = 1.0
    assert _lines(depth, faces, normals).astype(int).tolist() == [
        [1, 1, 1, 1, 0],  # it jumps to what is below
        [0, 1, 0, 0, 0],
    ]
    normals[:] = (0.0, 0.0, 1.0)  # faces that lie in one plane have no line between them
    assert not _lines(depth, faces, normals)[1].any()


def test_one_sees_through_a_hole_and_not_through_its_pin():
    open_beam, with_pin = (
        picture_of(plan_of(BEAM, *lines), View(0, 89.99), 4.0) for lines in ([], [pin(0, 0, 0)])
    )
    x, y = (round(value) for value in open_beam.pixel_of(np.zeros(3)))
    assert open_beam.owner[y, x] == -1
    assert with_pin.owner[y, x + 20] == 1  # the wall of the pin; its bore is open


def test_nearer_parts_occlude():
    plan = plan_of(
        "1 4 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat", "1 1 0 -40 -200 1 0 0 0 1 0 0 0 1 3713.dat"
    )
    assert picture_of(plan, View(0, 0)).visible([1]) == 0
    assert picture_of(plan, View(180, 0)).visible([1]) == 1


def test_new_parts_are_coloured_others_faded():
    picture = picture_of(plan_of(BEAM, pin(0, -10, 20), "1 4 0 -20 0 1 0 0 0 1 0 0 0 1 32316.dat"))
    bright, faded = (picture.pixels(shown, WHITE) for shown in ({2}, set()))
    red = lambda image: int(((image[..., 0] > 110) & (image[..., 1] < 60)).sum())  # noqa: E731
    assert red(bright) > 50
    assert red(faded) == 0


def test_long_step_is_split_into_few_pieces_each_about_as_many():
    lines = [f"1 4 {20 * at} 0 0 1 0 0 0 1 0 0 0 1 43857.dat" for at in range(20)]
    steps = steps_of(*lines)
    assert [len(step.items) for step in steps] == [7, 7, 6]
    kinds = [part for part in catalogue.parts() if part.family != "hubs"][:20]
    steps = steps_of(
        *(
            f"1 4 {100 * at} 0 0 1 0 0 0 1 0 0 0 1 {part.number}.dat"
            for at, part in enumerate(kinds)
        )
    )
    assert [len(step.items) for step in steps] == [4] * 5


def test_pin_is_drawn_outside_with_an_arrow_to_its_hole():
    (step,) = steps_of(BEAM, pin(0, -10, 20))
    ((start, end),) = step.scene.arrows
    shift = step.scene.shown[1].shift
    assert shift @ (0, -1, 0) > 40
    assert (end - start) @ (0, 1, 0) > 10
    assert np.allclose(end, [0, -10, 20])  # the upper end of the hole
    assert not step.scene.shown[0].shift.any()


def test_view_is_turned_for_a_hidden_part_and_the_turn_is_marked():
    bush = "1 1 0 -40 -150 1 0 0 0 1 0 0 0 1 3713.dat"
    steps = steps_of("1 4 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat", "0 STEP", bush)
    assert [step.is_turned for step in steps] == [False, True]
    assert steps[1].scene.view != VIEWS[0]


def test_part_that_is_enclosed_is_shown_without_what_hides_it():
    walls = [
        f"1 4 {x} {y} {z} 1 0 0 0 1 0 0 0 1 67718.dat"
        for x, y, z in np.array([[150, 0, 0], [-150, 0, 0], [0, 0, 230]])
    ]
    walls += [
        f"1 4 {x} {y} {z} 1 0 0 0 1 0 0 0 1 67718.dat"
        for x, y, z in ((0, 0, -230), (0, 90, 0), (0, -90, 0))
    ]
    steps = steps_of(*walls, "0 STEP", "1 1 0 -40 0 1 0 0 0 1 0 0 0 1 3713.dat")
    assert steps[-1].inset is not None
    assert len(steps[-1].inset.shown) == 1


def test_title_with_dollars_is_no_formula(coarse, tmp_path):
    assert write_booklet(plan_of("0 Robot for $_$", BEAM), tmp_path / "robot.pdf") == 3


def test_repeated_steps_share_a_page(coarse):
    turned = "1 16 100 0 0 -1 0 0 0 1 0 0 0 -1 wheel.ldr"
    lines = [
        "0 FILE car.ldr",
        "0 // A beam.",
        BEAM,
        "0 STEP",
        "1 16 0 0 0 1 0 0 0 1 0 0 0 1 wheel.ldr",
        turned,
    ]
    pages = list(Pages(plan_of(*lines, *WHEEL.split("\n"))))
    assert [(page.head, page.note) for page in pages[1:3]] == [("Parts", ""), ("1", "A beam.")]
    assert [
        (page.head, page.instruction.times, page.instruction.assembly != ()) for page in pages[3:]
    ] == [
        ("2", 2, True),
        ("3", 2, True),
        ("4", 1, False),
    ]
    assert [(item.count, item.text) for item in pages[-1].items] == [(2, "wheel")]


def test_sub_assemblies_of_two_colours_have_pages_of_their_own(coarse):
    other = "1 4 100 0 0 -1 0 0 0 1 0 0 0 -1 wheel.ldr"
    wheel = WHEEL.replace("1 71", "1 16").split("\n")
    pages = list(
        Pages(
            plan_of(
                "0 FILE car.ldr",
                BEAM,
                "0 STEP",
                "1 1 0 0 0 1 0 0 0 1 0 0 0 1 wheel.ldr",
                other,
                *wheel,
            )
        )
    )
    assert [page.head for page in pages[2:]] == ["1", "2", "3", "4", "5", "6"]
    assert [(item.count, item.text) for item in pages[-1].items] == [(1, "wheel"), (1, "wheel")]


def test_the_last_page_says_which_cable_goes_where(coarse):
    motor = "1 15 0 0 200 1 0 0 0 1 0 0 0 1 54696p02.dat"
    hub = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat"
    plan = plan_of(hub, "0 !BRICKSRL PORT C left", motor, "0 !BRICKSRL PORT Q", motor)
    page = Pages(plan)._cabling()
    (cable,) = page.cables  # a port that the hub lacks has none
    length_mm = np.linalg.norm(cable.ends[0] - cable.ends[1]) * 0.4
    assert page.lines == (
        f"Port C: Medium angular motor 'left', {length_mm:.0f} mm away; its cable has 250 mm",
    )
    assert (page.head, page.note[:24]) == ("Cables", "Plug in the cables last,")
    high, wide = page.picture.owner.shape
    for x, y in map(page.picture.pixel_of, cable.ends):
        assert 0 < x < wide
        assert 0 < y < high
    texts = [text.get_text() for text in sheets._figure(page, 4).texts]
    assert texts.count("C") == 2  # at both ends
    assert {"Cables", "4", *page.lines} <= set(texts)


def test_pages_for_a_browser_say_in_words_what_they_show(coarse):
    item = Item(picture_of(plan_of(BEAM)), 2, "Beam & pin")
    pages = [
        Page("1", "First <this>.", items=(item,)),
        Page("Cables", "", lines=("Port A: 'left'",)),
    ]
    text = sheets._html(plan_of("0 <Cart>", BEAM), pages).decode()
    assert "<title>&lt;Cart&gt;</title>" in text
    assert re.findall(r'<section><img alt="(.*?)" src="data:image/png;base64,iVBOR', text) == [
        "1. 2 x Beam &amp; pin. First &lt;this&gt;.",
        "Cables. Port A: &#x27;left&#x27;",
    ]


@pytest.mark.parametrize(
    ("view", "words"),
    [
        (View(40, 30), "from the front, left"),
        (View(-140, 30), "from behind, right"),
        (View(140, -30), "from behind, left, below"),
    ],
)
def test_a_turned_view_says_from_where_one_looks(view, words):
    figure = Figure()
    sheets._turn_mark(figure, view, (2.0, 2.0))
    assert [text.get_text() for text in figure.texts] == [words]


def boxes_of(figure):
    """Left, bottom, right and top of each box, inches."""
    return [
        (box.get_x(), box.get_y(), box.get_x() + box.get_width(), box.get_y() + box.get_height())
        for box in figure.artists
        if isinstance(box, FancyBboxPatch)
    ]


def pictures_of(figure):
    """The same of each picture."""
    width, height = figure.get_size_inches()
    return [
        (box.x0 * width, box.y0 * height, box.x1 * width, box.y1 * height)
        for box in (axes.get_position() for axes in figure.axes)
    ]


def texts_of(figure):
    """Place of each text, inches."""
    width, height = figure.get_size_inches()
    return {
        text.get_text(): (text.get_position()[0] * width, text.get_position()[1] * height)
        for text in figure.texts
    }


def lies_in(inner, outer, margin=0.0):
    return (
        inner[0] >= outer[0] + margin
        and inner[1] >= outer[1] + margin
        and inner[2] <= outer[2] - margin
        and inner[3] <= outer[3] - margin
    )


def page_figure():
    return Figure(figsize=(8.27, 5.83), dpi=DPI)


SMALL = picture_of(plan_of(BEAM), zoom=0.5)
PAPER = (0.0, 0.0, 8.27, 5.83)


def test_an_inset_lies_in_its_box_at_the_lower_right_above_the_bars():
    figure = page_figure()
    scene = Scene((), VIEWS[0], (), frozenset({0}))
    sheets._inset(figure, SMALL, scene, 0.9)
    ((box,), (picture,)) = boxes_of(figure), pictures_of(figure)
    wide, high = (side / DPI for side in SMALL.size)
    assert box == pytest.approx((7.82 - wide - 0.1, 0.95, 7.92, 1.05 + high + 0.1))
    assert picture == pytest.approx((box[0] + 0.1, box[1] + 0.1, box[2] - 0.1, box[3] - 0.1))
    assert box[1] > 0.9 and box[2] < PAPER[2]


def test_the_items_of_a_step_stand_one_below_the_other_in_their_box():
    figure = page_figure()
    items = [Item(SMALL, count, f"part {count}") for count in (2, 13, 100)]
    sheets._item_column(figure, items)
    (column,) = boxes_of(figure)
    pictures, texts = pictures_of(figure), texts_of(figure)
    assert lies_in(column, PAPER, 0.2) and len(pictures) == 3
    for number, (item, picture) in enumerate(zip(items, pictures, strict=True)):
        assert lies_in(picture, column)
        count, name = texts[f"{item.count}x"], texts[item.text]
        # Below its picture, and above that of the next item.
        assert column[1] < count[1] == name[1] < picture[1]
        assert number == 2 or count[1] > pictures[number + 1][3]
        # A digit of the count is as wide as a tenth of an inch.
        assert name[0] - count[0] == pytest.approx(0.15 + 0.1 * len(str(item.count)))
    long = page_figure()
    sheets._item_column(long, [Item(SMALL, 1, "Bevel gear with twenty teeth and a bush")])
    assert "Bevel gear with [...]" in texts_of(long)


def test_the_list_of_parts_has_rows_of_boxes_that_do_not_touch():
    figure = page_figure()
    items = [Item(SMALL, count, f"part {count}") for count in range(1, 14)]
    sheets._part_list(figure, items)
    boxes, pictures, texts = boxes_of(figure), pictures_of(figure), texts_of(figure)
    assert len(boxes) == len(pictures) == len(items)
    assert len({round(box[0], 6) for box in boxes}) == 6
    for number, (item, box, picture) in enumerate(zip(items, boxes, pictures, strict=True)):
        assert lies_in(box, PAPER, 0.1) and lies_in(picture, box)
        for text in (f"{item.count}x", item.text):
            x, y = texts[text]
            assert box[0] < x < box[0] + 0.2 and box[1] < y < box[3]
        assert texts[item.text][1] < picture[1] < texts[f"{item.count}x"][1]
        # Those before it are to its left, or above.
        assert all(other[2] < box[0] or box[3] < other[1] for other in boxes[:number])
    # The second row begins below the first one.
    assert boxes[6][0] == boxes[0][0] and boxes[6][3] < boxes[0][1]


@pytest.mark.parametrize(
    ("line", "modules", "width_mm", "marks"),
    [
        (BEAM, 5, 7.2, 5),
        ("1 4 0 0 0 1 0 0 0 1 0 0 0 1 32525.dat", 11, 7.2, 11),
        ("1 0 0 0 0 1 0 0 0 1 0 0 0 1 3705.dat", 4, 4.6, 3),
    ],
)
def test_a_bar_is_drawn_as_large_as_the_part(line, modules, width_mm, marks):
    (placed,) = plan_of(line).parts
    figure = page_figure()
    sheets._life_size(figure, placed, 0.7)
    ((left, bottom, right, top),) = boxes_of(figure)
    assert (right - left) * 25.4 == pytest.approx(8.0 * modules)
    assert (top - bottom) * 25.4 == pytest.approx(width_mm)
    assert (top + bottom) / 2 == pytest.approx(0.7)
    assert texts_of(figure)[f"{modules}   1:1"] == pytest.approx((right + 0.08, 0.7))
    holes = [patch for patch in figure.artists if isinstance(patch, Circle)]
    if holes:
        # In the middle of each module, of 4.8 mm.
        assert [hole.center[0] for hole in holes] == pytest.approx(
            [left + (number + 0.5) * 8.0 / 25.4 for number in range(marks)]
        )
        assert {round(2 * hole.radius * 25.4, 6) for hole in holes} == {4.8}
    else:
        lines = [mark for mark in figure.artists if isinstance(mark, Line2D)]
        # Between the modules, from side to side.
        assert [tuple(mark.get_xdata()) for mark in lines] == [
            pytest.approx((left + number * 8.0 / 25.4,) * 2) for number in range(1, marks + 1)
        ]
        assert all(tuple(mark.get_ydata()) == pytest.approx((bottom, top)) for mark in lines)


def test_a_bar_too_long_to_stand_beside_the_items_begins_at_the_edge():
    lefts = {}
    for number in ("40490", "41239", "32278"):  # 9, 13 and 15 modules
        (placed,) = plan_of(f"1 4 0 0 0 1 0 0 0 1 0 0 0 1 {number}.dat").parts
        figure = page_figure()
        sheets._life_size(figure, placed, 0.7)
        (box,) = boxes_of(figure)
        lefts[modules_of(placed)] = box[0]
        assert box[2] < PAPER[2] - 0.3
    assert lefts == {9: 2.35, 13: 2.35, 15: 2.35}
    (placed,) = plan_of("1 0 0 0 0 1 0 0 0 1 0 0 0 1 50450.dat").parts  # 32
    figure = page_figure()
    sheets._life_size(figure, placed, 0.7)
    assert boxes_of(figure)[0][0] == 0.3


@pytest.mark.parametrize("turn_deg", [40.0, -40.0, 140.0, -140.0])
@pytest.mark.parametrize("tilt_deg", [30.0, -30.0])
def test_the_compass_points_where_the_robots_front_and_right_are_seen(turn_deg, tilt_deg):
    figure = page_figure()
    sheets._compass(figure, View(turn_deg, tilt_deg), (7.0, 5.0))
    turn, tilt = math.radians(turn_deg), math.radians(tilt_deg)
    # From the front, the robot's right is on the left; from above, its front is below.
    right = (math.cos(turn), -math.sin(turn) * math.sin(tilt))
    front = (math.sin(turn), math.cos(turn) * math.sin(tilt))
    texts = {text.get_text(): text for text in figure.texts}
    arrows = [patch for patch in figure.artists if isinstance(patch, FancyArrowPatch)]
    tips = [patch._posA_posB[1] for patch in arrows]
    for name, (x, y), tip in (("right", right, tips[1]), ("front", front, tips[3])):
        assert tip == pytest.approx((7.0 - 0.42 * x, 5.0 - 0.42 * y), abs=1e-9)
        place = texts_of(figure)[name]
        # Beyond the tip, on the same side, and written away from it.
        assert math.dist(place, (7.0, 5.0)) > math.dist(tip, (7.0, 5.0))
        assert texts[name].get_ha() == ("left" if tip[0] > 7.0 else "right")


def test_arrows_are_dashed_and_grey_where_they_run_behind_parts():
    wall = plan_of("1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat")
    picture = picture_of(wall, View(0, 0), 2.0)
    over, behind, above = (
        (np.array([0.0, y, z]), np.array([0.0, y + 20.0, z]))
        for y, z in ((0.0, 60.0), (0.0, -60.0), (-90.0, -60.0))
    )
    scene = Scene((), picture.view, (over, behind, above), frozenset())
    figure = page_figure()
    corner = sheets._put(figure, picture, None, WHITE, (4.0, 3.0))
    sheets._arrows(figure, picture, corner, scene)
    arrows = [patch for patch in figure.artists if isinstance(patch, FancyArrowPatch)]
    # Each has a white one below it.
    seen = [(arrow.get_edgecolor()[:3], arrow.get_linestyle()) for arrow in arrows[1::2]]
    grey, bold = (0.4, 0.4, 0.4), to_rgb("#d9480f")
    assert seen == [(bold, "-"), (grey, "--"), (bold, "-")]
    assert [arrow.get_linewidth() - 1.6 for arrow in arrows[::2]] == pytest.approx(
        [arrow.get_linewidth() for arrow in arrows[1::2]]
    )
    # As far on the page as in the picture, of 360 points to the inch.
    (tail_x, tail_y), (tip_x, tip_y) = arrows[0]._posA_posB
    assert (tip_x - tail_x, tip_y - tail_y) == pytest.approx((0.0, -20.0 * 2.0 / 360))


def test_a_picture_lies_on_the_page_point_by_point():
    figure = page_figure()
    left, top = sheets._put(figure, SMALL, {0}, WHITE, (4.0, 3.0))
    wide, high = SMALL.size
    (box,) = pictures_of(figure)
    assert box == pytest.approx((left, top - high / 360, left + wide / 360, top))
    assert ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2) == pytest.approx((4.0, 3.0))
    x, y = SMALL.pixel_of(np.array([10.0, 5.0, 20.0]))
    assert sheets._inches(SMALL, (left, top), np.array([10.0, 5.0, 20.0])) == pytest.approx(
        (left + x / 360, top - y / 360)
    )


def test_pages_of_sub_assemblies_say_what_is_built_and_how_often(coarse):
    scene = Scene((), VIEWS[0], (), frozenset({0}))
    for times, title in ((1, "left leg"), (3, "left leg  ·  build it 3 times")):
        step = Instruction((), frozenset(), ("left_leg.ldr:1",), times, "", scene)
        figure = sheets._figure(Page("7", "", SMALL, (), step), 12)
        assert {"7", "12", title} <= set(texts_of(figure))
        assert figure.artists[0].get_facecolor()[:3] != WHITE
        assert lies_in(boxes_of(figure)[0], PAPER, 0.1)


def test_a_faded_part_is_paler_and_a_black_one_has_light_lines():
    def looks(code):
        bright, faded = (_look(code, is_bright=is_bright) for is_bright in (True, False))
        # The last coat is that of a part's own lines.
        return bright[:-1], faded[:-1], bright[-1], faded[-1]

    for code in (4, 0, 15, 71):
        bright, faded, line, faded_line = looks(code)
        assert bright.min() >= 0.0 and bright.max() <= 1.0
        # About half of each colour becomes nearly white.
        assert np.ptp(faded, axis=0) == pytest.approx(0.48 * np.ptp(bright, axis=0))
        assert faded.min() > 0.45 and (faded >= bright - 0.05).all()
        assert faded_line.tolist() == [0.5] * 3
        assert line.max() == line.min() == (0.5 if code == 0 else 0.1)
    # Shade is seen on black too.
    black, *_ = looks(0)
    assert black.max() > 0.1


def test_few_colours_are_kept_and_paper_keeps_its_own():
    palette = _Palette((0.9, 0.8, 0.7))
    first = palette.first_of(4, is_bright=True)
    # After paper and two tones of lines; the same look has the same numbers.
    assert first == 3 and palette.first_of(4, is_bright=True) == 3
    second = palette.first_of(4, is_bright=False)
    assert (
        second - first
        == len(_look(4, is_bright=True))
        == palette.first_of(1, is_bright=True) - second
    )
    coats = np.zeros((3, 80), dtype=np.uint16)
    coats[1] = np.arange(first, first + 80)
    coats[2, :3] = (1, 2, second)
    exact = palette.pixels(coats, 256)
    assert exact.shape == (3, 80, 4) and (exact[..., 3] == 255).all()
    assert exact[0, 0, :3].tolist() == [230, 204, 178]
    tones = _look(4, is_bright=True)[:80]
    assert np.abs(exact[1, :, :3] - 255 * tones).max() <= 0.5 + 1e-9
    few = palette.pixels(coats, 16)
    assert len(np.unique(few.reshape(-1, 4), axis=0)) <= 16
    assert (few[0] == exact[0]).all()
    assert np.abs(few.astype(int) - exact.astype(int)).mean() < 12


@pytest.mark.parametrize(("turn_deg", "tilt_deg"), [(0.0, 0.0), (40.0, 30.0), (-140.0, -30.0)])
def test_a_view_looks_from_its_turn_and_its_tilt(turn_deg, tilt_deg):
    right, down, away = View(turn_deg, tilt_deg).axes
    turn, tilt = math.radians(turn_deg), math.radians(tilt_deg)
    # A plan's y points down, its z to the front, its x to the right of the robot.
    viewer = [-math.sin(turn) * math.cos(tilt), -math.sin(tilt), math.cos(turn) * math.cos(tilt)]
    assert -away == pytest.approx(viewer)
    assert right == pytest.approx([-math.cos(turn), 0.0, -math.sin(turn)])
    assert down == pytest.approx(np.cross(away, right)) and down[1] > 0


def test_a_picture_is_as_large_as_its_parts_with_a_margin():
    plan = plan_of("1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat")
    shown = [Shown(plan.parts[0], np.zeros(3))]
    width, height = extent(shown, View(0, 0))
    # 4 x 2 studs are 80 by 40, 24 high; only the picture has the studs too, of 4.
    assert (width, height) == pytest.approx((80.0, 24.0))
    assert extent(shown, View(90, 0)) == pytest.approx((40.0, 24.0))
    moved = [*shown, Shown(plan.parts[0], np.array([100.0, 0.0, 0.0]))]
    assert extent(moved, View(0, 0))[0] == pytest.approx(180.0)
    picture = Studio().picture(shown, View(0, 0), 2.0, margin=7)
    assert picture.size == pytest.approx((2 * 80 + 14, 2 * 28 + 14), abs=2)
    rows, columns = np.nonzero(picture.owner == 0)
    assert (columns.min(), rows.min()) == (7, 7)
    assert picture.alone == {0: len(rows)} and picture.visible([0]) == 1.0
    # A point of the plan is where its pixel is: a corner of the brick.
    x, y = picture.pixel_of(np.array([-40.0, 24.0, 20.0]))
    assert (round(x), round(y)) == (columns.max() + 1, rows.max() + 1)


@pytest.mark.parametrize(
    ("visible", "chosen", "hidden"),
    [
        # Enough in the default view: no other one is tried.
        ({0: (0.9, 0.95)}, 0, []),
        # The view in which the least visible item is seen best.
        ({0: (0.1, 0.9), 1: (0.6, 0.6), 2: (0.05, 1.0)}, 1, []),
        ({0: (0.3, 0.3), 1: (0.0, 1.0), 3: (0.75, 0.8)}, 3, []),
        ({0: (0.3, 0.3), 1: (0.0, 1.0)}, 0, [(4,), (7,)]),
        # It is not turned for little, and what no view shows is told.
        ({0: (0.4, 0.4), 1: (0.44, 0.44)}, 0, []),
        ({0: (0.0, 0.9)}, 0, [(4,)]),
    ],
)
def test_a_step_is_seen_from_where_its_most_hidden_item_is_seen_best(visible, chosen, hidden):
    class Trial:
        def __init__(self, view):
            self.shares = visible.get(VIEWS.index(view), (0.0, 0.0))

        def visible(self, item):
            return self.shares[0 if item == (4,) else 1]

    tried = []

    def picture(shown, view, zoom):
        tried.append(view)
        return Trial(view)

    author = _Author.__new__(_Author)
    author.studio = SimpleNamespace(picture=picture)
    author.view = VIEWS[0]
    author._apart = lambda moves, before: ([], ())
    moves = [SimpleNamespace(parts=(4, 7), items=((4,), (7,)))]
    scene, unseen = author._best_scene(moves, frozenset())
    assert VIEWS.index(scene.view) == chosen and unseen == hidden
    assert scene.bright == {4, 7} and tried[0] is VIEWS[0]
    assert (len(tried) == 1) is (visible[0][0] > 0.45)
    # That of the step before comes second.
    author.view, tried[:] = VIEWS[5], []
    author._best_scene(moves, frozenset())
    assert len(tried) == 1 or tried[1] is VIEWS[5]


@pytest.mark.slow
def test_cables_are_labelled_at_both_ends():
    page = list(Pages(read_plan(PLANS / "two_wheeler.ldr")))[-1]
    assert [cable.port for cable in page.cables] == ["A", "C", "E"]
    high, wide = page.picture.owner.shape
    for cable in page.cables:
        for x, y in map(page.picture.pixel_of, cable.ends):
            assert 0 < x < wide
            assert 0 < y < high


def test_mirrored_unknown_and_single_parts_have_a_booklet(coarse, tmp_path):
    mirrored = "1 4 0 -20 0 -1 0 0 0 1 0 0 0 1 32316.dat"
    unknown = "1 4 0 -40 0 1 0 0 0 1 0 0 0 1 99999.dat"
    assert (
        write_booklet(plan_of(BEAM, pin(0, -10, 20), mirrored, unknown), tmp_path / "robot.pdf")
        == 3
    )
    assert write_booklet(plan_of(BEAM), tmp_path / "beam.html") == 3


def built_from(plan, step):
    """Errors of a step, found by building from it."""
    errors = []
    items, depth = step.items, len(step.assembly)
    if len(items) > MAX_PIECES or len({kind_of(plan, item, depth) for item in items}) > MAX_KINDS:
        errors.append("too many parts")
    studio, occupancy = Studio(), Occupancy(plan.parts)
    scenes = [scene for scene in (step.scene, step.inset) if scene is not None]
    pictures = [studio.picture(scene.shown, scene.view, 0.8) for scene in scenes]
    for item in items:
        shares = [picture.visible(item) for picture in pictures if item[0] in picture.alone]
        if max(shares) < MIN_VISIBLE:
            errors.append(f"{plan.parts[item[0]].name} is hidden")
    present = set(step.before)
    for move in step.moves:
        if present:
            others = np.isin(np.arange(len(plan.parts)), list(present))
            if not move.outward.any() or not all(
                occupancy.is_free(move.parts, others, move.outward * d) for d in (6, 20, 60, 150)
            ):
                errors.append(f"{plan.parts[move.parts[0]].name} has no way in")
        present |= set(move.parts)
    return errors


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_wheeler", "walker", "robo_arm"])
def test_robot_can_be_built_from_its_booklet(name):
    plan = read_plan(PLANS / f"{name}.ldr")
    steps = list(instructions(plan, Studio()))
    assert [built_from(plan, step) for step in steps] == [[]] * len(steps)


def test_each_page_is_told_of_when_it_is_drawn(coarse, tmp_path):
    told = []
    count = write_booklet(
        plan_of(BEAM, "0 STEP", pin(0, -10, 20)),
        tmp_path / "robot.pdf",
        lambda *page: told.append(page),
    )
    assert told == [(0, 0), *((number, count) for number in range(1, count + 1))]


def test_committed_booklet_is_that_of_the_plan_as_it_is(coarse, tmp_path):
    plan = tmp_path / "plans" / "my_robot.ldr"
    plan.parent.mkdir()
    (tmp_path / "docs" / "plans").mkdir(parents=True)
    plan.write_text(BEAM + "\n")
    assert committed_booklet(plan) is None
    booklet = tmp_path / "docs" / "plans" / "my_robot.pdf"
    write_booklet(read_plan(plan), booklet)
    assert committed_booklet(plan) == booklet
    plan.write_text(BEAM + "\n" + pin(0, -10, 20) + "\n")
    assert committed_booklet(plan) is None


@pytest.mark.parametrize("name", ["two_wheeler", "walker", "robo_arm", "ev3_driver"])
def test_committed_booklets_are_those_of_our_plans(name):
    assert committed_booklet(PLANS / f"{name}.ldr") is not None, "run `make booklets`"


@pytest.mark.slow
def test_two_wheeler_booklet(tmp_path):
    plan = read_plan(PLANS / "two_wheeler.ldr")
    pages = write_booklet(plan, tmp_path / "plan.pdf")
    assert write_booklet(plan, tmp_path / "plan.html") == pages == 14
    pdf, html = (
        (tmp_path / "plan.pdf").read_bytes(),
        (tmp_path / "plan.html").read_text(encoding="utf-8"),
    )
    assert pdf.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", pdf)) == pages
    assert html.count("<section>") == pages
    assert "Port A: Medium angular motor &#x27;right&#x27;" in html
    assert len(pdf) < 3_000_000


def test_booklet_suffix_selects_format(tmp_path):
    with pytest.raises(PlanError, match=r"a booklet is a \.pdf or \.html file"):
        write_booklet(plan_of(BEAM), tmp_path / "plan.doc")
    with pytest.raises(PlanError, match="has no part that the catalogue knows"):
        write_booklet(plan_of(BEAM.replace("32316", "99999")), tmp_path / "plan.pdf")
