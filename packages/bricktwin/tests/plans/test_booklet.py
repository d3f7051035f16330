"""Pictures and booklets."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from plan_lines import BEAM, PLANS, pin, plan_of, solid_volume

from brickhub.errors import PlanError
from bricktwin.plans import catalogue
from bricktwin.plans.booklet import sheets
from bricktwin.plans.booklet.committed import committed_booklet
from bricktwin.plans.booklet.instructions import (
    MAX_KINDS,
    MAX_PIECES,
    MIN_VISIBLE,
    instructions,
    kind_of,
)
from bricktwin.plans.booklet.pages import Item, Page, Pages
from bricktwin.plans.booklet.picture import VIEWS, Shown, Studio, View, sprite_of
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
