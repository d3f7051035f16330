"""Looks of a plan's parts: where they are drawn, in which colours, and what others hide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_lines import BEAM, pin, plan_of

from bricktwin.plans import catalogue, ldraw_library
from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing import pieces, planned_looks
from bricktwin.plans.drawing.looks import TINTS, Tint
from bricktwin.plans.drawing.pieces import Piece, colour_name
from bricktwin.plans.drawing.planned_looks import cables_of, looks_of
from bricktwin.plans.geometry import Floats

ORIGIN = np.zeros(3)
MM = 0.4
"""Of one LDU."""
BRICK = "1 4 0 0 0 1 0 0 0 1 0 0 0 1 3004.dat"
"""A brick of 1 x 2: 40 LDU along x, 24 high with studs of 4, 20 along z."""
MOTOR = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"
HUB = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat"


@pytest.fixture(autouse=True)
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Our own drawings, whatever is installed."""
    monkeypatch.delenv("LDRAWDIR", raising=False)
    monkeypatch.setattr(ldraw_library, "_SYSTEM_FOLDERS", ())


def bounds(piece: Piece) -> tuple[Floats, Floats]:
    points = np.concatenate([shape.points for _, shape in piece.shapes])
    return points.min(axis=0), points.max(axis=0)


def faces(piece: Piece) -> int:
    return sum(len(shape.faces) for _, shape in piece.shapes)


def expected_bounds(line: str) -> tuple[Floats, Floats]:
    """Of a part that is drawn 0.1 mm inside of its sides, in the twin's axes, mm."""
    (placed,) = plan_of(line).parts
    low, high = placed.bounds
    # Front, left and up of the twin are z, -x and -y of the plan.
    lowest = MM * np.array([low[2], -high[0], -high[1]])
    highest = MM * np.array([high[2], -low[0], -low[1]])
    return lowest, highest


@pytest.mark.parametrize(
    "place",
    [
        "0 0 0 1 0 0 0 1 0 0 0 1",
        "100 -50 30 1 0 0 0 1 0 0 0 1",
        "0 0 0 0 0 1 0 1 0 -1 0 0",
        "7 8 9 0 1 0 -1 0 0 0 0 1",
    ],
)
def test_a_part_is_drawn_a_tenth_of_a_millimetre_inside_of_its_sides(place: str) -> None:
    line = f"1 4 {place} 32316.dat"
    drawn = looks_of(plan_of(line), [0], ORIGIN)
    lowest, highest = expected_bounds(line)
    low, high = bounds(drawn)
    assert low == pytest.approx(lowest + 0.1, abs=0.07)
    assert high == pytest.approx(highest - 0.1, abs=0.07)
    # It has the colour of its line; the rims of its holes are dark.
    assert colour_name(colour_of(4).rgb) in {colour for colour, _ in drawn.shapes}


def test_looks_are_in_the_frame_of_their_body() -> None:
    plan = plan_of(BRICK)
    there = looks_of(plan, [0], ORIGIN)
    here = looks_of(plan, [0], np.array([0.1, 0.2, 0.3]))
    for before, after in zip(bounds(there), bounds(here), strict=True):
        assert after == pytest.approx(before - (100.0, 200.0, 300.0))
    # Axes of a body are rows: its x is up, its y to the front, its z to the left.
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = looks_of(plan, [0], np.array([0.1, 0.2, 0.3]), axes=axes)
    for before, after in zip(bounds(here), bounds(turned), strict=True):
        assert after == pytest.approx(before[[2, 0, 1]])
    normals = (np.concatenate([shape.normals for _, shape in one.shapes]) for one in (here, turned))
    before, after = normals
    assert after == pytest.approx(before[:, [2, 0, 1]])


def test_faces_and_normals_of_what_is_drawn_look_outwards() -> None:
    for _, shape in looks_of(plan_of(BRICK), [0], ORIGIN).shapes:
        corners = shape.points[shape.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = shape.normals[shape.faces].mean(axis=1)
        assert (np.einsum("ij,ij->i", across, normals) > 0).all()


def test_what_lies_in_another_part_of_the_body_is_left_out() -> None:
    inside = "1 1 0 12 0 1 0 0 0 1 0 0 0 1 4519.dat"
    alone = looks_of(plan_of(inside), [0], ORIGIN)
    big = "1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat"
    plan = plan_of(big, inside)
    together = looks_of(plan, [0, 1], ORIGIN)
    brick = looks_of(plan, [0], ORIGIN)
    assert faces(together) < faces(brick) + faces(alone)
    blue = colour_name(colour_of(1).rgb)
    drawn = [shape for colour, shape in together.shapes if colour == blue]
    # An axle of 24 mm in a brick of 32 mm is hidden from end to end.
    assert not drawn
    # Of another body, it hides nothing.
    assert faces(looks_of(plan, [1], ORIGIN)) == faces(alone)


def test_points_that_no_triangle_uses_are_left_out() -> None:
    plan = plan_of(BEAM, pin(0, 0, 20))
    drawn = looks_of(plan, [0, 1], ORIGIN)
    alone = faces(looks_of(plan, [0], ORIGIN)) + faces(looks_of(plan, [1], ORIGIN))
    assert 0 < faces(drawn) < alone
    for _, shape in drawn.shapes:
        assert np.unique(shape.faces).tolist() == list(range(len(shape.points)))
        assert shape.normals.shape == shape.points.shape


def test_an_installed_library_hides_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its shapes are others than our solids, which say what hides what."""
    plan = plan_of("1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat", "1 1 0 12 0 1 0 0 0 1 0 0 0 1 4519.dat")
    alone = faces(looks_of(plan, [0], ORIGIN)) + faces(looks_of(plan, [1], ORIGIN))
    monkeypatch.setattr(ldraw_library, "folder", lambda: tmp_path)
    monkeypatch.setattr(ldraw_library, "triangles_of", lambda root, name: {})
    assert faces(looks_of(plan, [0, 1], ORIGIN)) == alone


def test_a_library_draws_a_part_by_any_of_its_numbers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    part = next(one for one in catalogue.parts() if one.aliases and one.device is None)
    triangle = np.array([[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]]])
    asked: list[str] = []

    def triangles_of(root: Path, name: str) -> Any:
        asked.append(name)
        is_known = name == f"{part.aliases[0]}.dat"
        return {16: triangle, 4: 2 * triangle} if is_known else {}

    monkeypatch.setattr(ldraw_library, "folder", lambda: tmp_path)
    monkeypatch.setattr(ldraw_library, "triangles_of", triangles_of)
    monkeypatch.setattr(ldraw_library, "rgba", lambda root, code: (1.0, 0.0, 0.0, 0.5))
    planned_looks._of_library.cache_clear()
    plan = plan_of(f"1 1 0 0 0 1 0 0 0 1 0 0 0 1 {part.number}.dat")
    drawn = looks_of(plan, [0], ORIGIN)
    planned_looks._of_library.cache_clear()
    assert asked == [f"{part.number}.dat", f"{part.aliases[0]}.dat"]
    # Its main colour is that of the line.
    assert [colour for colour, _ in drawn.shapes] == [
        colour_name(colour_of(1).rgb),
        "#ff000080",
    ]
    assert [np.ptp(shape.points, axis=0).max() for _, shape in drawn.shapes] == [4.0, 8.0]


def test_a_motor_is_drawn_without_its_output_which_turns() -> None:
    for number in ("54675", "54696p02"):
        plan = plan_of(f"1 15 0 0 0 1 0 0 0 1 0 0 0 1 {number}.dat")
        case = looks_of(plan, [0], ORIGIN)
        output = looks_of(plan, [], ORIGIN, shafts=[0])
        turning = colour_name(TINTS[Tint.TURNING])
        assert [colour for colour, _ in output.shapes] == [turning]
        assert turning not in {colour for colour, _ in case.shapes}
        # Both together are drawn side by side, and the output hides nothing of the case.
        both = looks_of(plan, [0], ORIGIN, shafts=[0])
        assert faces(both) == faces(case) + faces(output)
        low, high = bounds(output)
        sizes = high - low
        assert 10.0 < sizes.max() < 40.0


@pytest.mark.parametrize("number", ["67718", "54696p02", "37316"])
def test_drawings_in_detail_fill_the_case_of_their_part(number: str) -> None:
    part = catalogue.get(number)
    case = part.solids[0].corners()
    low, high = case.min(axis=0), case.max(axis=0)
    points = np.concatenate([shape.points for _, shape in planned_looks._detailed(part)])
    assert len(planned_looks._detailed(part)) >= 3
    # Their middles are in one place, and they are as large within a few millimetres.
    assert (points.min(axis=0) + points.max(axis=0)) / 2 == pytest.approx((low + high) / 2)
    assert np.ptp(points, axis=0) == pytest.approx(high - low, abs=17.0)
    # Rigid drawings are turned by whole quarters, and are not mirrored.
    for _, shape in planned_looks._detailed(part):
        corners = shape.points[shape.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = shape.normals[shape.faces].mean(axis=1)
        assert (np.einsum("ij,ij->i", across, normals) > -1e-9).all()


def test_wheels_from_four_centimetres_on_have_spokes() -> None:
    wheels = [part for part in catalogue.parts() if part.wheel_mm and part.device is None]
    for part in wheels:
        assert bool(planned_looks._detailed(part)) is (part.wheel_mm > 40.0), part.number
    wheel = catalogue.get("39367p02")
    points = np.concatenate([shape.points for _, shape in planned_looks._detailed(wheel)])
    # It is as large as it rolls, and turns about its z.
    assert np.ptp(points, axis=0)[:2] * MM == pytest.approx([56.0, 56.0], abs=0.5)
    assert planned_looks._detailed(catalogue.get("32316")) == []


@pytest.mark.parametrize(
    ("axes", "rows"),
    [
        ((1, 2, 3), np.eye(3)),
        ((3, -1, -2), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
        ((-3, -2, -1), [[0, 0, -1], [0, -1, 0], [-1, 0, 0]]),
    ],
)
def test_signed_axes_are_rows_of_a_rotation(axes: tuple[int, int, int], rows: Any) -> None:
    assert planned_looks._rotation_to_drawing(axes).tolist() == np.array(rows).tolist()


def test_only_parts_whose_bounds_touch_can_hide_one_another() -> None:
    beside = [BRICK.replace("1 4 0 0 0", f"1 4 {x} 0 0") for x in (0, 40, 80, 41)]
    parts = plan_of(*beside).parts
    assert planned_looks._touching(parts[0], parts) == [parts[1]]
    assert planned_looks._touching(parts[1], parts) == [parts[0], parts[2], parts[3]]
    above = plan_of(BRICK, BRICK.replace("1 4 0 0 0", "1 4 0 -24 0")).parts
    assert planned_looks._touching(above[0], above) == [above[1]]


def cable_lines(
    monkeypatch: pytest.MonkeyPatch, *lines: str, origin_m: Floats = ORIGIN
) -> list[Floats]:
    """The four points of each cable, mm."""
    drawn: list[Floats] = []

    def cable(points: Any) -> Piece:
        drawn.append(np.array(points))
        return Piece(())

    monkeypatch.setattr(pieces, "cable", cable)
    plan = plan_of(*lines)
    found = cables_of(plan, range(len(plan.parts)), origin_m)
    assert len(found) == len(drawn)
    return drawn


def test_a_cable_goes_from_the_hubs_socket_to_the_devices_plug(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    motor = MOTOR.replace("1 15 0 0 0", "1 15 300 -40 20")
    lines = (HUB, "0 !BRICKSRL PORT C left", motor, "0 !BRICKSRL PORT Q", MOTOR, BEAM)
    (line,) = cable_lines(monkeypatch, *lines)
    hub, placed = plan_of(HUB, motor).parts
    socket = np.array(dict(hub.electric.ports)["C"])
    plug = placed.point(placed.electric.plug)
    ends = [hub.point(socket), plug]
    expected = [MM * np.array([z, -x, -y]) for x, y, z in ends]
    assert line[0] == pytest.approx(expected[0]) and line[3] == pytest.approx(expected[1])
    # It leaves both straight, by 32 mm: the hub's side, and the back of the motor.
    assert np.linalg.norm(line[1] - line[0]) == pytest.approx(32.0)
    assert np.linalg.norm(line[2] - line[3]) == pytest.approx(32.0)
    middle = MM * np.array([0.0, 0.0, 0.0])
    assert (line[1] - line[0]) @ (line[0] - middle) > 0
    device = MM * np.array([placed.position[2], -placed.position[0], -placed.position[1]])
    assert (line[2] - line[3]) @ (line[3] - device) > 0
    # In the frame of a body elsewhere.
    (moved,) = cable_lines(monkeypatch, *lines, origin_m=np.array([0.1, 0.2, 0.3]))
    assert moved == pytest.approx(line - (100.0, 200.0, 300.0))


def test_without_a_hub_there_is_no_cable(monkeypatch: pytest.MonkeyPatch) -> None:
    assert cable_lines(monkeypatch, "0 !BRICKSRL PORT C left", MOTOR) == []
    # The first one of two hubs has them, and a device without a port has none.
    lines = (HUB, HUB.replace("1 15 0 0 0", "1 15 0 200 0"), MOTOR, "0 !BRICKSRL PORT A", MOTOR)
    assert len(cable_lines(monkeypatch, *lines)) == 1


def test_each_port_is_in_the_side_out_of_which_its_cable_comes() -> None:
    (hub,) = plan_of(HUB).parts
    low, high = hub.part.bounds
    for name, place in hub.electric.ports:
        outward = planned_looks._outward(hub, np.array(place))
        assert np.abs(outward).sum() == 1.0
        # Ports A, C and E are on one long side, B, D and F on the other.
        (axis,) = np.flatnonzero(outward)
        middle = (low + high) / 2
        assert outward[axis] == np.sign(place[axis] - middle[axis]), name
        nearest = high[axis] if outward[axis] > 0 else low[axis]
        assert abs(place[axis] - nearest) < 0.15 * (high[axis] - low[axis])
