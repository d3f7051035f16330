"""Drawings of LEGO parts in more detail than the catalogue has, from our own dimensions in
millimetres. Looks only, without mass.

A :class:`Piece` is a set of coloured shapes.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bricktwin.plans.drawing.shapes import (
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    Shape,
    block,
    box,
    cylinder,
    discs,
    extruded,
    merge,
    ring,
    rounded_rectangle,
    tube,
    turned,
)
from bricktwin.plans.geometry import Triple


@dataclass(frozen=True)
class Piece:
    """LEGO part: shapes, each with the name of its colour."""

    shapes: tuple[tuple[str, Shape], ...]

    def at(
        self,
        x: float,
        y: float,
        z: float,
    ) -> "Piece":
        """The part, translated."""
        return Piece(tuple((colour, shape.at(x, y, z)) for colour, shape in self.shapes))

    def turned(
        self,
        axis: Triple,
        angle_deg: float,
    ) -> "Piece":
        """The part, rotated about an axis through the origin."""
        return Piece(
            tuple((colour, shape.turned(axis, angle_deg)) for colour, shape in self.shapes)
        )


def piece(**shapes: Shape) -> Piece:
    """The part of these shapes, by the names of their colours."""
    return Piece(tuple(shapes.items()))


def colour_name(rgba: Iterable[float]) -> str:
    """Name ``"#rrggbbaa"`` of a colour, from red, green, blue and opacity in 0..1; opaque by
    default."""
    digits = "".join(f"{round(255 * value):02x}" for value in rgba)
    # Opaque is "ff", which fills up a colour that was given without its opacity.
    return "#" + digits.ljust(8, "f")


MODULE = 8.0
"""Distance between the holes of a beam, mm."""
_HOLE_RADIUS = 2.5
COLOURS: dict[str, tuple[float, float, float]] = {
    "white": (0.93, 0.93, 0.92),
    "light_grey": (0.66, 0.68, 0.70),
    "dark_grey": (0.33, 0.35, 0.37),
    "black": (0.09, 0.09, 0.10),
    "turquoise": (0.02, 0.60, 0.62),
    "yellow": (1.00, 0.78, 0.10),
    "blue": (0.10, 0.36, 0.75),
    "dim": (0.24, 0.25, 0.27),
    "glow": (1.00, 0.95, 0.70),
    "azure": (0.35, 0.80, 0.95),
    "red": (0.85, 0.03, 0.03),
}
GLOWING = {"glow", "azure"}
"""Names of the colours that emit light."""
# A hub shows this heart when it is switched on; each mark is a lamp.
_HEART = (".#.#.", "#####", "#####", ".###.", "..#..")


def beam(holes: int, colour: str) -> Piece:
    """Technic beam along x with its holes along z, centred."""
    length = holes * MODULE
    bar = extruded(rounded_rectangle(length - 0.2, 7.6, 3.2), 7.4, bevel=0.5)
    centres = [(index - (holes - 1) / 2) * MODULE for index in range(holes)]
    # Only the two ends of a hole are drawn, as dark discs a little outside of the beam, where
    # nothing hides them.
    holes_shown = [discs(_HOLE_RADIUS, 7.5).at(x, 0, 0) for x in centres]
    return Piece(((colour, bar), ("dim", merge(holes_shown))))


def hub() -> Piece:
    """Prime hub lying flat, 88 x 56 x 32, USB port towards +x, centred."""
    upper = box(88, 56, 22, radius=2.5).at(0, 0, 5)
    lower = box(86, 54.5, 11, radius=1.5).at(0, 0, -10.5)
    lit, unlit = _lamps()
    window = extruded(rounded_rectangle(33, 33, 3), 0.8).at(17, 0, 16)
    button = cylinder(6.6, 2.0, bevel=0.6).at(-20, 0, 16.4)
    light = ring(9.4, 6.6, 1.2).at(-20, 0, 16.1)
    steering = [box(9, 7, 1.4, radius=0.5).at(-20, side * 17, 16.1) for side in (1, -1)]
    bluetooth = cylinder(3.4, 1.2, bevel=0.4).at(36, -20, 16.2)
    # These lie in the sides of the hub, with three ports on each of the long ones.
    port = box(15, 1.2, 8.5, radius=0.5, arc=1)
    ports = [port.at(x, y, 5) for x in (26, 0, -26) for y in (27.8, -27.8)]
    usb = box(1.2, 9, 3.6, radius=0.5, arc=1).at(43.8, 0, 5)
    hole = discs(_HOLE_RADIUS, 55.2).along(Y_AXIS)
    holes = [hole.at(x, 0, -10.5) for x in (-32, -24, -16, 16, 24, 32)]
    slot = discs(1.0, 88.4, 6).along(X_AXIS)
    speaker = [slot.at(-0.1, y, z) for y in (-8, -4, 0, 4, 8) for z in (3, 7)]
    return piece(
        white=merge([upper, button, *steering]),
        turquoise=lower,
        black=merge([window, *ports, usb]),
        dim=merge([*unlit, *holes, *speaker]),
        glow=merge(lit),
        azure=merge([light, bluetooth]),
    )


def _lamps() -> tuple[list[Shape], list[Shape]]:
    """Lamps of a hub's matrix that are lit, and those that are not."""
    lit: list[Shape] = []
    unlit: list[Shape] = []
    lamp = block(4.8, 4.8, 1.0)
    for row, line in enumerate(_HEART):
        for column, mark in enumerate(line):
            # The matrix is read with the USB port up, so its rows go down along -x and its columns
            # along -y.
            placed = lamp.at(17 + (2 - row) * 6, (2 - column) * 6, 16.2)
            if mark == "#":
                lit.append(placed)
            else:
                unlit.append(placed)
    return lit, unlit


def medium_motor() -> Piece:
    """Medium motor along x, 72 long, its outputs towards +y and -y, 24 from the front; origin on
    the outputs' axis."""
    case = medium_motor_case(31.0)
    outputs = cylinder(10.8, 33.0, bevel=0.6).along(Y_AXIS)
    return Piece((*case.shapes, ("dark_grey", outputs)))


def medium_motor_case(width: float = 23.8) -> Piece:
    """Medium motor without its outputs."""
    front = extruded(rounded_rectangle(24, 24, 11.0), width, bevel=1.0).along(Y_AXIS)
    housing = box(52, width, 23.6, radius=2.2).at(-26, 0, 0)
    cap = box(16, width + 1, 24.4, radius=2.2).at(-53, 0, 0)
    stripe = box(26, width + 1, 6, radius=0.8).at(-28, 0, 3)
    hole = discs(_HOLE_RADIUS, width + 1.2).along(Y_AXIS)
    holes = [hole.at(x, 0, -7) for x in (-16, -40)]
    return piece(
        white=merge([front, housing]),
        dark_grey=cap,
        light_grey=stripe,
        dim=merge(holes),
    )


def axle(length: float) -> Piece:
    """A cross axle along y, centred."""
    blades = [box(4.6, length, 1.8, radius=0.4, arc=1), box(1.8, length, 4.6, radius=0.4, arc=1)]
    return piece(dark_grey=merge(blades))


def wheel(diameter: float) -> Piece:
    """A wheel with a black tyre on a light rim, axis along y, centred. The rim has six spokes if
    there is room for them."""
    outer = diameter / 2
    inner = diameter / 2 - 7.5
    # The profile of the tyre is (radius, z) from its upper inner edge outwards. The lower half
    # mirrors the upper one, and the first point closes it.
    upper = [(inner, 6.2), (outer - 3.4, 7.0), (outer - 1.0, 5.6), (outer - 0.3, 3.0)]
    lower = [(radius, -z) for radius, z in reversed(upper)]
    tyre = turned([*upper, *lower, upper[0]])
    tread = block(1.9, 2.2, 11.6).at(outer - 0.95, 0, 0)
    treads = [tread.turned(Z_AXIS, 15 * step) for step in range(24)]
    middle = _rim(inner)
    # `turned` and `ring` draw about z, so everything is laid down here at the end.
    return piece(
        black=merge([tyre, *treads]).along(Y_AXIS),
        light_grey=middle.along(Y_AXIS),
        dim=cylinder(inner - 1, 3).along(Y_AXIS),
    )


def _rim(radius: float) -> Shape:
    """Rim of a wheel, axis along z, centred."""
    hub_radius = 6.4
    inside = radius - 3.2
    # Where the hub cap reaches the rim there is no room for spokes.
    if inside <= hub_radius:
        return cylinder(max(radius, hub_radius), 13, bevel=0.8)
    rim = ring(radius, inside, 12.6)
    hub_cap = cylinder(hub_radius, 13, bevel=0.8)
    spoke = box(radius - 5, 4.2, 9.4, radius=0.8).at((radius + 3) / 2, 0, 0)
    spokes = [spoke.turned(Z_AXIS, 60 * step) for step in range(6)]
    return merge([rim, hub_cap, *spokes])


def ultrasonic_sensor() -> Piece:
    """Ultrasonic sensor facing +x, 24 x 56 x 24, centred."""
    case = box(20, 56, 23.6, radius=2.0).at(-2, 0, 0)
    face = extruded(rounded_rectangle(22.5, 55, 10.5), 4, bevel=0.8).along(X_AXIS).at(9.6, 0, 0)
    rim = ring(10.2, 7.8, 3.4).along(X_AXIS)
    membrane = turned([(0, 1.6), (3.5, 1.2), (7.8, 0), (7.8, -1), (0, -1)]).along(X_AXIS)
    pupil = cylinder(2.6, 1.0, bevel=0.3).along(X_AXIS)
    eyes_y = (15.5, -15.5)
    rims = [rim.at(11.2, y, 0) for y in eyes_y]
    membranes = [membrane.at(11.2, y, 0) for y in eyes_y]
    pupils = [pupil.at(12.6, y, 0) for y in eyes_y]
    return piece(
        white=merge([case, *rims]),
        black=merge([face, *pupils]),
        dim=merge(membranes),
    )


def ball_caster(radius: float) -> Piece:
    """Steel ball in its socket; origin at the centre of the ball."""
    angles = [math.radians(step) for step in range(0, 181, 20)]
    ball = turned([(radius * math.sin(angle), radius * math.cos(angle)) for angle in angles])
    wall = radius + 3.4
    # The profile runs from the top outwards and down to the rim, which holds the ball below its
    # equator, and then up on the inside.
    profile = [(0, 16), (10, 16), (wall, 11), (wall, 1), (radius + 2, -1.5), (radius, -1.5), (0, 4)]
    socket = turned(profile)
    return piece(light_grey=ball, dark_grey=socket)


def cable(points: Sequence[Triple]) -> Piece:
    """Black cable of round section along a Bezier curve."""
    return piece(black=tube(points, 1.7))
