"""Pictures and booklets."""

from __future__ import annotations

import re

import numpy as np
import pytest
from plan_lines import BEAM, PLANS, pin, plan_of, solid_volume

from brickhub.errors import PlanError
from bricktwin.plans import booklet, catalogue
from bricktwin.plans.booklet import pages_of, write_booklet
from bricktwin.plans.picture import VIEWS, Canvas, View, surface_of
from bricktwin.plans.plan import read_plan

WHEEL = "0 FILE wheel.ldr\n1 71 0 0 0 1 0 0 0 1 0 0 0 1 39367p02.dat\n0 STEP\n1 71 0 0 20 1 0 0 0 1 0 0 0 1 3713.dat"


@pytest.fixture
def thumbnails(monkeypatch):
    """Pages are drawn in small."""
    for name in ("_STEP_SIZE", "_COVER_SIZE"):
        monkeypatch.setattr(booklet, name, (190, 135))


def test_every_part_is_drawn_at_its_size():
    for part in catalogue.parts():
        surface = surface_of(part)
        points = surface.triangles.reshape(-1, 3)
        low, high = part.bounds
        assert len(surface.tints) == len(surface.triangles)
        assert np.abs(points.min(axis=0) - low).max() < 4.5, part.number
        assert np.abs(points.max(axis=0) - high).max() < 4.5, part.number


def test_surfaces_face_outwards():
    for part in catalogue.parts():
        triangles = surface_of(part).triangles
        volume = float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum()) / 6
        full = solid_volume(part)
        # Solids overlap one another, and holes are discs on their surface.
        assert 0.6 * full < volume < 4.0 * full, part.number


def test_default_view_is_upright_from_front_left():
    right, down, away = VIEWS[0].axes
    assert np.allclose(np.stack([right, down, away]) @ np.stack([right, down, away]).T, np.eye(3))
    assert np.allclose(np.cross(right, down), away)
    assert right[1] == pytest.approx(0)
    assert down[1] > 0  # a plan's y points down
    assert away[1] > 0  # from above, one looks down
    assert away[2] < 0  # from the front, one looks backwards


def test_box_covers_its_projection():
    plan = plan_of("1 4 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat")
    canvas = Canvas((300, 200), View(0, 0), plan.parts)
    canvas.add(plan.parts[0])
    # From the front the hub is 140 x 80, which fills 94 % of the height or width of the picture.
    scale = canvas.zoom
    assert canvas.visible({0}) == pytest.approx(140 * 80 * scale**2, rel=0.03)


def test_nearer_parts_occlude():
    lines = ["1 4 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat", "1 1 0 -40 -200 1 0 0 0 1 0 0 0 1 3713.dat"]
    plan = plan_of(*lines)
    canvas = Canvas((300, 200), View(0, 0), plan.parts)
    for placed in plan.parts:
        canvas.add(placed)
    assert canvas.visible({1}) == 0
    behind = Canvas((300, 200), View(180, 0), plan.parts)
    for placed in plan.parts:
        behind.add(placed)
    assert behind.visible({1}) > 0


def test_new_parts_are_coloured_others_faded():
    plan = plan_of(BEAM, pin(0, -10, 20), "1 4 0 -20 0 1 0 0 0 1 0 0 0 1 32316.dat")
    bright, faded = (Canvas((200, 150), VIEWS[0], plan.parts, plan.parts).picture(shown) for shown in ({2}, set()))
    red = lambda image: int(((image[..., 0] > 110) & (image[..., 1] < 60)).sum())  # noqa: E731
    assert red(bright) > 200
    assert red(faded) == 0


def test_step_of_many_kinds_has_its_parts_on_pages_before(thumbnails, tmp_path):
    kinds = [part for part in catalogue.parts() if part.family != "hubs"][:20]
    plan = plan_of(*(f"1 4 {100 * at} 0 0 1 0 0 0 1 0 0 0 1 {part.number}.dat" for at, part in enumerate(kinds)))
    assert [(page.head, len(page.items)) for page in pages_of(plan)][3:6] == [("1", 16), ("1", 4), ("1", 0)]
    write_booklet(plan, tmp_path / "robot.pdf")


def test_title_with_dollars_is_no_formula(thumbnails, tmp_path):
    assert write_booklet(plan_of("0 Robot for $_$", BEAM), tmp_path / "robot.pdf") == 3


def test_repeated_steps_share_a_page(thumbnails):
    turned = "1 16 100 0 0 -1 0 0 0 1 0 0 0 -1 wheel.ldr"
    plan = plan_of(
        "0 FILE car.ldr", "0 // A beam.", BEAM, "0 STEP", "1 16 0 0 0 1 0 0 0 1 0 0 0 1 wheel.ldr", turned, *WHEEL.split("\n")
    )
    heads = [(page.head, page.note) for page in pages_of(plan)]
    assert heads[1:3] == [("Parts", ""), ("1", "A beam.")]
    assert [head for head, _ in heads[3:]] == ["2 · wheel, 2 times", "3 · wheel, 2 times", "4"]
    assert [(item.count, item.text) for item in list(pages_of(plan))[-1].items] == [(2, "wheel")]


def test_sub_assemblies_of_two_colours_have_pages_of_their_own(thumbnails):
    other = "1 4 100 0 0 -1 0 0 0 1 0 0 0 -1 wheel.ldr"
    wheel = WHEEL.replace("1 71", "1 16").split("\n")
    plan = plan_of("0 FILE car.ldr", BEAM, "0 STEP", "1 1 0 0 0 1 0 0 0 1 0 0 0 1 wheel.ldr", other, *wheel)
    pages = list(pages_of(plan))
    assert [page.head for page in pages[3:]] == ["2 · wheel", "3 · wheel", "4 · wheel", "5 · wheel", "6"]
    assert [(item.count, item.text) for item in pages[-1].items] == [(1, "wheel"), (1, "wheel")]


def test_hidden_new_pin_is_outlined():
    upper = BEAM.replace("1 4 0 0 0", "1 4 0 -20 0")
    orange = lambda page: int(((page.picture[..., 0] > 140) & (page.picture[..., 2] < 70) & (page.picture[..., 1] > 60)).sum())  # noqa: E731
    hidden, alone = (list(pages_of(plan_of(BEAM, *lines)))[-1] for lines in ([upper, pin(0, -10, 20)], [upper]))
    assert orange(hidden) > orange(alone) + 20


def test_cables_are_labelled_at_both_ends(thumbnails):
    plan = read_plan(PLANS / "two_wheeler.ldr")
    page = list(pages_of(plan))[-1]
    assert [cable.port for cable in page.cables] == ["A", "C", "E"]
    high, wide = page.picture.shape[:2]
    assert all(0 < x < wide and 0 < y < high for cable in page.cables for x, y in cable.ends)


@pytest.mark.slow
def test_two_wheeler_booklet(tmp_path):
    plan = read_plan(PLANS / "two_wheeler.ldr")
    pages = write_booklet(plan, tmp_path / "plan.pdf")
    assert write_booklet(plan, tmp_path / "plan.html") == pages == 14
    pdf, html = (tmp_path / "plan.pdf").read_bytes(), (tmp_path / "plan.html").read_text(encoding="utf-8")
    assert pdf.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", pdf)) == pages
    assert html.count("<section>") == pages
    assert "Port A: Medium angular motor &#x27;right&#x27;" in html
    assert len(pdf) < 2_000_000


def test_booklet_suffix_selects_format(tmp_path):
    with pytest.raises(PlanError, match=r"a booklet is a \.pdf or \.html file"):
        write_booklet(plan_of(BEAM), tmp_path / "plan.doc")
    with pytest.raises(PlanError, match="has no part that the catalogue knows"):
        write_booklet(plan_of(BEAM.replace("32316", "99999")), tmp_path / "plan.pdf")
