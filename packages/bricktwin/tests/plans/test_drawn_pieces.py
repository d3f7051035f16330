"""Our own drawings of LEGO parts: each of their bodies, by where it is and how large it is, mm."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from bricktwin.plans.drawing import pieces
from bricktwin.plans.drawing.pieces import Piece, colour_name
from bricktwin.plans.drawing.shapes import Shape
from bricktwin.plans.geometry import Floats

Solid = tuple[tuple[float, ...], tuple[float, ...]]
"""Middle and size of a body."""


def solids(shape: Shape) -> list[tuple[Floats, Floats]]:
    """Lowest and highest corner of each body of a shape: of the triangles that hang together."""
    _, number = np.unique(shape.points.round(6), axis=0, return_inverse=True)
    faces = number.ravel()[shape.faces]
    group = np.arange(number.max() + 1)
    for _ in range(100):
        lowest = group[faces].min(axis=1)
        before = group.copy()
        for corner in range(3):
            np.minimum.at(group, faces[:, corner], lowest)
        group = group[group]
        if (group == before).all():
            break
    of_points = group[number.ravel()]
    used = np.unique(shape.faces)
    found = []
    for root in np.unique(of_points[used]):
        points = shape.points[used][of_points[used] == root]
        found.append((points.min(axis=0), points.max(axis=0)))
    return found


def place_of(solid: Solid) -> tuple[int, ...]:
    """Whole millimetres of a body's middle, by which bodies are in order."""
    return tuple(round(value) for value in solid[0])


def drawn(piece: Piece, colour: str) -> list[Solid]:
    """Bodies of a colour, rounded to a tenth, in order."""
    found = []
    for low, high in solids(dict(piece.shapes)[colour]):
        middle = ((low + high) / 2).round(1) + 0.0
        size = (high - low).round(1) + 0.0
        found.append((tuple(middle.tolist()), tuple(size.tolist())))
    return sorted(found, key=place_of)


def about(expected: list[Solid]) -> list[Solid]:
    """Bodies within a few tenths, as circles are drawn with corners."""
    return [
        (pytest.approx(middle, abs=0.16), pytest.approx(size, abs=0.26))  # type: ignore[misc]
        for middle, size in sorted(expected, key=place_of)
    ]


def test_a_hub_has_its_ports_in_its_long_sides_and_its_lamps_on_top() -> None:
    hub = pieces.hub()
    (lower,) = drawn(hub, "turquoise")
    assert lower == ((0.0, 0.0, -10.5), (86.0, 54.5, 11.0))
    # The upper half, on which are the round button and two that steer.
    assert drawn(hub, "white") == about(
        [
            ((0.0, 0.0, 5.0), (88.0, 56.0, 22.0)),
            ((-20.0, 0.0, 16.4), (13.2, 13.2, 2.0)),
            ((-20.0, 17.0, 16.1), (9.0, 7.0, 1.4)),
            ((-20.0, -17.0, 16.1), (9.0, 7.0, 1.4)),
        ]
    )
    # A window of 33 mm with the lamps, six ports, and USB in the front.
    ports = [
        ((x, side * 27.8, 5.0), (15.0, 1.2, 8.5)) for x in (26.0, 0.0, -26.0) for side in (1, -1)
    ]
    window = ((17.0, 0.0, 16.0), (33.0, 33.0, 0.8))
    assert drawn(hub, "black") == about([window, *ports, ((43.8, 0.0, 5.0), (1.2, 9.0, 3.6))])
    # A ring of light around the button, and Bluetooth in a corner.
    assert drawn(hub, "azure") == about(
        [((-20.0, 0.0, 16.1), (18.8, 18.8, 1.2)), ((36.0, -20.0, 16.2), (6.8, 6.8, 1.2))]
    )


def test_a_hub_shows_a_heart_upright_with_its_usb_port_up() -> None:
    hub = pieces.hub()
    lit = drawn(hub, "glow")
    assert {size for _, size in lit} == {(4.8, 4.8, 1.0)}
    # Rows go down along -x, columns to the right along -y, 6 mm apart around the window's middle.
    rows = [["." for _ in range(5)] for _ in range(5)]
    for (x, y, z), _ in lit:
        rows[round((29.0 - x) / 6.0)][round((12.0 - y) / 6.0)] = "#"
        assert z == 16.2
    assert ["".join(row) for row in rows] == [".#.#.", "#####", "#####", ".###.", "..#.."]
    dark = [solid for solid in drawn(hub, "dim") if solid[1] == (4.8, 4.8, 1.0)]
    assert len(lit) + len(dark) == 25


def test_holes_and_the_speaker_of_a_hub_are_dark_in_its_sides() -> None:
    discs = [solid for solid in drawn(pieces.hub(), "dim") if solid[1] != (4.8, 4.8, 1.0)]
    sides = [solid for solid in discs if solid[1][1] < 0.1]
    ends = [solid for solid in discs if solid[1][0] < 0.1]
    holes = [
        ((x, side * 27.6, -10.5), (5.0, 0.0, 5.0))
        for x in (-32.0, -24.0, -16.0, 16.0, 24.0, 32.0)
        for side in (1, -1)
    ]
    assert sides == about(holes)
    slots = Counter((middle[1], middle[2]) for middle, _ in ends)
    assert set(slots) == {(y, z) for y in (-8.0, -4.0, 0.0, 4.0, 8.0) for z in (3.0, 7.0)}
    assert {round(abs(middle[0] + 0.1), 1) for middle, _ in ends} == {44.2}


@pytest.mark.parametrize("holes", [2, 5, 13])
def test_a_beam_has_a_hole_in_the_middle_of_each_module(holes: int) -> None:
    beam = pieces.beam(holes, "red")
    ((middle, size),) = drawn(beam, "red")
    assert middle == (0.0, 0.0, 0.0)
    assert size == pytest.approx((8.0 * holes - 0.2, 7.6, 7.4), abs=0.26)
    ends = [
        (((2 * number - holes + 1) * 4.0, 0.0, side * 3.75), (5.0, 5.0, 0.0))
        for number in range(holes)
        for side in (1, -1)
    ]
    assert drawn(beam, "dim") == about(ends)


def test_a_medium_motor_is_72_long_and_its_outputs_are_24_from_its_front() -> None:
    motor = pieces.medium_motor()
    # A round front of 24, a box behind it, and a cap at the back.
    assert drawn(motor, "white") == about(
        [((0.0, 0.0, 0.0), (24.0, 31.0, 24.0)), ((-26.0, 0.0, 0.0), (52.0, 31.0, 23.6))]
    )
    shapes = [shape for colour, shape in motor.shapes if colour == "dark_grey"]
    cap, outputs = (tuple(np.ptp(shape.points, axis=0).round(1).tolist()) for shape in shapes)
    assert cap == (16.0, 32.0, 24.4) and outputs == pytest.approx((21.6, 33.0, 21.6), abs=0.26)
    points = np.concatenate([shape.points for _, shape in motor.shapes])
    assert (points[:, 0].min(), points[:, 0].max()) == pytest.approx((-61.0, 12.0), abs=0.05)
    assert drawn(motor, "light_grey") == [((-28.0, 0.0, 3.0), (26.0, 32.0, 6.0))]
    holes = [((x, side * 16.1, -7.0), (5.0, 0.0, 5.0)) for x in (-16.0, -40.0) for side in (1, -1)]
    assert drawn(motor, "dim") == about(holes)
    # Without its outputs it is as wide as its case.
    case = pieces.medium_motor_case()
    assert [size[1] for _, size in drawn(case, "white")] == [23.8, 23.8]


def test_an_axle_is_a_cross() -> None:
    ((_, shape),) = pieces.axle(32.0).shapes
    sizes = sorted(size for _, size in drawn(pieces.axle(32.0), "dark_grey"))
    assert sizes == [(1.8, 32.0, 4.6), (4.6, 32.0, 1.8)]
    assert np.abs(shape.points).max(axis=0) == pytest.approx([2.3, 16.0, 2.3])


def test_a_wheel_has_24_treads_and_six_spokes() -> None:
    wheel = pieces.wheel(56.0)
    black = drawn(wheel, "black")
    # The tyre, and blocks of 2.2 x 11.6 that are turned around it.
    treads = [solid for solid in black if solid[1][1] == 11.6]
    assert len(treads) == 24 and len(black) == 25
    radii = [math.hypot(middle[0], middle[2]) for middle, _ in treads]
    assert radii == pytest.approx([28.0 - 0.95] * 24, abs=0.1)
    angles = sorted(round(math.degrees(math.atan2(z, x))) % 360 for (x, _, z), _ in treads)
    assert angles == pytest.approx(list(range(0, 360, 15)), abs=1)
    (tyre,) = (solid for solid in black if solid[1][1] != 11.6)
    # The treads stand out of it by 0.3 mm.
    assert tyre[1] == pytest.approx((55.4, 14.0, 55.4), abs=0.3)
    # Of the rim, a ring to 15 mm below the tyre's edge and a cap of 12.8, with spokes between.
    light = drawn(wheel, "light_grey")
    spokes = [solid for solid in light if 9.3 < solid[1][1] < 9.5]
    assert len(light) == 8 and len(spokes) == 6
    places = [math.hypot(middle[0], middle[2]) for middle, _ in spokes]
    assert places == pytest.approx([(20.5 + 3.0) / 2] * 6, abs=0.1)
    ring, cap = sorted((solid[1] for solid in light if solid not in spokes), reverse=True)
    assert ring == pytest.approx((41.0, 12.6, 41.0), abs=0.3)
    assert cap == pytest.approx((12.8, 13.0, 12.8), abs=0.2)
    ((_, disc),) = drawn(wheel, "dim")
    assert disc == pytest.approx((39.0, 3.0, 39.0), abs=0.3)


def test_an_ultrasonic_sensor_has_two_eyes_in_its_face() -> None:
    sensor = pieces.ultrasonic_sensor()
    rims = [((11.2, side * 15.5, 0.0), (3.4, 20.4, 20.4)) for side in (1, -1)]
    assert drawn(sensor, "white") == about([((-2.0, 0.0, 0.0), (20.0, 56.0, 23.6)), *rims])
    pupils = [((12.6, side * 15.5, 0.0), (1.0, 5.2, 5.2)) for side in (1, -1)]
    assert drawn(sensor, "black") == about([((9.6, 0.0, 0.0), (4.0, 55.0, 22.5)), *pupils])
    # Membranes, whose middles stand out of the rims' back.
    membranes = drawn(sensor, "dim")
    assert [middle[1] for middle, _ in membranes] == [-15.5, 15.5]
    for middle, size in membranes:
        assert size == pytest.approx((2.6, 15.6, 15.6), abs=0.2)
        assert middle[0] == pytest.approx(11.2 + 0.3, abs=0.06)


def test_a_caster_is_a_ball_in_a_socket_that_reaches_below_its_middle() -> None:
    caster = pieces.ball_caster(9.6)
    ((middle, size),) = drawn(caster, "light_grey")
    assert middle == (0.0, 0.0, 0.0) and size == pytest.approx((19.2,) * 3, abs=0.4)
    socket = dict(caster.shapes)["dark_grey"].points
    assert (socket[:, 2].min(), socket[:, 2].max()) == (-1.5, 16.0)
    assert np.ptp(socket, axis=0)[:2] == pytest.approx([26.0, 26.0], abs=0.2)
    # It holds the ball by a rim of its radius, and is 20 mm wide at the top.
    top = socket[socket[:, 2] == 16.0]
    assert np.ptp(top, axis=0)[:2] == pytest.approx([20.0, 20.0], abs=0.2)
    low = socket[socket[:, 2] == -1.5]
    radii = np.hypot(low[:, 0], low[:, 1]).round(6)
    assert set(radii.tolist()) == {9.6, 11.6}
    walls = socket[np.isin(socket[:, 2], (1.0, 11.0))]
    assert np.hypot(walls[:, 0], walls[:, 1]) == pytest.approx(13.0)


def test_a_cable_is_as_thick_as_a_real_one() -> None:
    line = [(0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (60.0, 0.0, 0.0), (90.0, 0.0, 0.0)]
    ((colour, shape),) = pieces.cable(line).shapes
    assert colour == "black"
    assert np.ptp(shape.points, axis=0) == pytest.approx([90.0, 3.4, 3.4], abs=0.3)


@pytest.mark.parametrize(
    ("rgba", "name"),
    [
        ((1.0, 0.0, 0.5), "#ff0080ff"),
        ((0.0, 0.2, 1.0, 0.25), "#0033ff40"),
        ((0.01, 0.02, 0.03, 1.0), "#030508ff"),
    ],
)
def test_a_colour_is_named_by_its_bytes(rgba: tuple[float, ...], name: str) -> None:
    assert colour_name(rgba) == name
    # Two digits of each are exact to a 255th.
    digits = [int(name[at : at + 2], 16) / 255 for at in range(1, len(name), 2)]
    assert digits[: len(rgba)] == pytest.approx(rgba, abs=0.5 / 255 + 1e-9)


def test_named_colours_are_shares_of_light_and_two_of_them_glow() -> None:
    assert all(0.0 <= value <= 1.0 for rgb in pieces.COLOURS.values() for value in rgb)
    assert pieces.COLOURS.keys() >= pieces.GLOWING
    # What is grey is grey, and darker by its name.
    tones = [pieces.COLOURS[name] for name in ("white", "light_grey", "dark_grey", "dim", "black")]
    assert all(max(rgb) - min(rgb) < 0.05 for rgb in tones)
    assert [sum(rgb) for rgb in tones] == sorted((sum(rgb) for rgb in tones), reverse=True)
    for name, channel in (("red", 0), ("blue", 2)):
        rgb = pieces.COLOURS[name]
        assert max(rgb) == rgb[channel] > 2 * sorted(rgb)[1]


def test_a_piece_is_moved_and_turned_whole() -> None:
    beam = pieces.beam(3, "red")
    moved = beam.at(1.0, 2.0, 3.0).turned((0.0, 0.0, 1.0), 90.0)
    for (colour, before), (same, after) in zip(beam.shapes, moved.shapes, strict=True):
        assert colour == same
        x, y, z = before.points.T
        assert after.points == pytest.approx(np.stack([-(y + 2.0), x + 1.0, z + 3.0], axis=1))
