"""Looks of a plan's parts: our meshes or those of an installed LDraw library, also of shafts that
turn visually only."""

import functools
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from bricktwin.plans import ldraw_library
from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing import pieces as drawings
from bricktwin.plans.drawing.looks import TINTS, Tint
from bricktwin.plans.drawing.meshes import offset_points, surface_of
from bricktwin.plans.drawing.pieces import colour_name
from bricktwin.plans.drawing.shapes import Shape, shape_of
from bricktwin.plans.geometry import MM_PER_LDU, Floats
from bricktwin.plans.mechanism.kinematics import TO_TWIN
from bricktwin.plans.part import DeviceKind, Part
from bricktwin.plans.plan import Placed, Plan

_CLEARANCE = 0.5
"""LDU: 0.1 mm on each side of a part."""
_BEND = 80.0
"""LDU: how far a cable's curve is pulled away from its ends."""
_SPOKED_MM = 40.0
"""Diameter from which a wheel is drawn with spokes."""
_DETAILED: dict[str, tuple[Callable[[], drawings.Piece], tuple[int, int, int]]] = {
    "prime": (drawings.hub, (3, -1, -2)),
    "spike-medium": (drawings.medium_motor_case, (-3, -2, -1)),
    "UltrasonicSensor": (drawings.ultrasonic_sensor, (-3, 1, -2)),
}
"""Our drawings of electric parts, and the signed axes of the catalogue's parts that are x, y and z
there (1 is a part's x)."""
_WHEEL_AXES = (-1, -3, -2)


def looks_of(
    plan: Plan,
    parts: Iterable[int],
    origin_m: Floats,
    *,
    axes: Floats | None = None,
    shafts: Iterable[int] = (),
) -> drawings.Piece:
    """Looks of parts of a plan in the frame of their body, mm.

    Args:
        parts: indices of the parts.
        origin_m: the body's origin [3] in the twin's axes.
        axes: the body's axes as rows [3, 3]; by default the twin's.
        shafts: indices of motors of which only the turning output is drawn; it is left out
            otherwise.
    """
    frame = (np.eye(3) if axes is None else axes) @ TO_TWIN
    shift = (np.eye(3) if axes is None else axes) @ origin_m * 1000
    shapes: list[tuple[str, Shape]] = []
    placed_parts = [plan.parts[part] for part in parts]
    motors = [plan.parts[motor] for motor in shafts]
    for placed, is_shaft in [
        *((part, False) for part in placed_parts),
        *((motor, True) for motor in motors),
    ]:
        turn = frame @ placed.rotation
        # the shapes of a library are not those of our solids
        can_hide = not is_shaft and ldraw_library.folder() is None
        low, high = placed.bounds
        near = [
            part
            for part in placed_parts
            if can_hide and (part.bounds[0] <= high).all() and (low <= part.bounds[1]).all()
        ]
        for colour, shape in _shapes(placed, only_turning=is_shaft):
            visible = _uncovered(placed, shape, [part for part in near if part is not placed])
            points = (visible.points @ turn.T + frame @ placed.position) * MM_PER_LDU - shift
            if len(visible.faces):
                shapes.append((colour, Shape(points, visible.normals @ turn.T, visible.faces)))
    return drawings.Piece(tuple(shapes))


def _uncovered(placed: Placed, shape: Shape, others: list[Placed]) -> Shape:
    """A shape of a part without the triangles that other parts hide, which have material just
    outside."""
    samples = offset_points(placed.to_plan(shape.points)[shape.faces], _CLEARANCE)
    covered = np.zeros(samples.shape[:2], dtype=bool)
    for other in others:
        points = other.to_part(samples.reshape(-1, 3))
        for solid in other.part.solids:
            covered |= solid.contains(points, 0.0).reshape(covered.shape)
    visible = shape.faces[~covered.all(axis=1)]
    used, faces = np.unique(visible, return_inverse=True)
    return Shape(
        shape.points[used], shape.normals[used], faces.reshape(visible.shape).astype(np.int32)
    )


def _shapes(placed: Placed, *, only_turning: bool) -> list[tuple[str, Shape]]:
    """Coloured shapes of a part in its frame, in LDraw units."""
    main = colour_of(placed.colour).rgb
    if (
        not only_turning
        and (root := ldraw_library.folder()) is not None
        and (shapes := _of_library(placed.part, root))
    ):
        return [(colour or colour_name(main), shape) for colour, shape in shapes]
    device = placed.part.device
    is_motor = device is not None and device.kind is DeviceKind.MOTOR
    if not only_turning and (detailed := _detailed(placed.part)):
        return detailed
    by_tint = _of_catalogue(placed.part).items()
    shown = [
        (tint, shape)
        for tint, shape in by_tint
        if not is_motor or only_turning is (tint is Tint.TURNING)
    ]
    return [(colour_name(TINTS.get(tint, main)), shape) for tint, shape in shown]


@functools.lru_cache(maxsize=512)
def _of_catalogue(part: Part) -> dict[Tint, Shape]:
    """Our shapes of a part."""
    surface = surface_of(part)
    low, high = part.bounds
    # Smaller by the clearance between parts, so that no two surfaces coincide.
    triangles = surface.triangles * (1.0 - _CLEARANCE / np.maximum(high - low, 10.0))
    shapes = {tint: shape_of(triangles[surface.tints == int(tint)]) for tint in Tint}
    return {tint: shape for tint, shape in shapes.items() if shape is not None}


@functools.lru_cache(maxsize=64)
def _detailed(part: Part) -> list[tuple[str, Shape]]:
    """Our detailed shapes of a hub, motor, sensor or wheel, without a motor's output; empty if
    there are none."""
    device = part.device.name if part.device is not None else ""
    if device in _DETAILED:
        make, axes = _DETAILED[device]
        drawing = make()
    elif part.wheel_mm > _SPOKED_MM:
        drawing = drawings.wheel(part.wheel_mm)
        axes = _WHEEL_AXES
    else:
        return []
    turn = np.zeros((3, 3))  # from the part's axes to ours
    for row, axis in enumerate(axes):
        turn[row, abs(axis) - 1] = np.sign(axis)
    points = np.concatenate([shape.points for _, shape in drawing.shapes]) @ turn / MM_PER_LDU
    low, high = part.bounds
    case = part.solids[0].corners()
    low, high = (case.min(axis=0), case.max(axis=0)) if device else (low, high)
    shift = (low + high - points.min(axis=0) - points.max(axis=0)) / 2
    return [
        (colour, Shape(shape.points @ turn / MM_PER_LDU + shift, shape.normals @ turn, shape.faces))
        for colour, shape in drawing.shapes
    ]


@functools.lru_cache(maxsize=256)
def _of_library(part: Part, root: Path) -> tuple[tuple[str, Shape], ...]:
    """Shapes of a part in an LDraw library by colour, "" for its main colour; empty if it has
    none."""
    found = (
        ldraw_library.triangles_of(root, f"{number}.dat") for number in (part.number, *part.aliases)
    )
    by_colour = next(filter(None, found), {})
    shapes = {code: shape_of(triangles) for code, triangles in by_colour.items()}
    names = {
        code: ""
        if code == ldraw_library.MAIN_COLOUR
        else colour_name(ldraw_library.rgba(root, code))
        for code in shapes
    }
    return tuple((names[code], shape) for code, shape in shapes.items() if shape is not None)


def cables_of(plan: Plan, parts: Iterable[int], origin_m: Floats) -> list[drawings.Piece]:
    """Cables between the hub and the motors and sensors on the same body, in that body's frame,
    mm."""
    devices = [(plan.parts[part], plan.parts[part].part.device) for part in parts]
    hub = next(
        (
            placed
            for placed, device in devices
            if device is not None and device.kind is DeviceKind.HUB
        ),
        None,
    )
    sockets = dict(hub.part.device.ports) if hub is not None and hub.part.device is not None else {}
    cables = []
    for placed, device in devices:
        if hub is None or placed is hub or device is None or placed.port not in sockets:
            continue
        socket = np.array(sockets[placed.port])
        plug = np.array(device.plug)
        outward = np.sign(socket) * [_BEND, 0.0, 0.0]
        back = np.sign(plug) * [0.0, 0.0, _BEND]
        line = np.concatenate(
            [
                hub.to_plan(np.stack([socket, socket + outward])),
                placed.to_plan(np.stack([plug + back, plug])),
            ]
        )
        cables.append(
            drawings.cable(
                [
                    (x, y, z)
                    for x, y, z in (line @ TO_TWIN.T * MM_PER_LDU - origin_m * 1000).tolist()
                ]
            )
        )
    return cables
