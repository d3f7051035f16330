"""Looks of a plan's parts: our meshes or those of an installed LDraw library, also of shafts that
turn visually only."""

import functools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from bricktwin.plans import ldraw_library
from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing import pieces
from bricktwin.plans.drawing.looks import TINTS, Tint
from bricktwin.plans.drawing.meshes import offset_points, surface_of
from bricktwin.plans.drawing.pieces import Piece, colour_name
from bricktwin.plans.drawing.shapes import Shape, shape_of
from bricktwin.plans.geometry import MM_PER_LDU, Floats
from bricktwin.plans.mechanism.kinematics import TO_TWIN
from bricktwin.plans.part import DeviceKind, Part
from bricktwin.plans.plan import Placed, Plan

_CLEARANCE = 0.5
"""Clearance between two parts (LDU), which is 0.1 mm on each side."""
_BEND = 80.0
"""Distance by which a cable's curve is pulled away from its ends, LDU."""
_SPOKED_MM = 40.0
"""Diameter from which a wheel is drawn with spokes."""
_DETAILED: dict[str, tuple[Callable[[], Piece], tuple[int, int, int]]] = {
    "prime": (pieces.hub, (3, -1, -2)),
    "spike-medium": (pieces.medium_motor_case, (-3, -2, -1)),
    "UltrasonicSensor": (pieces.ultrasonic_sensor, (-3, 1, -2)),
}
"""Our drawings of electric parts, each with the signed axes of the catalogue's part that are x, y
and z in the drawing (1 is the part's x)."""
_WHEEL_AXES = (-1, -3, -2)
"""Signed axes of a wheel in the catalogue that are x, y and z in our drawing."""


def looks_of(
    plan: Plan,
    parts: Iterable[int],
    origin_m: Floats,
    *,
    axes: Floats | None = None,
    shafts: Iterable[int] = (),
) -> Piece:
    """Looks of parts of a plan in the frame of their body, mm.

    Args:
        parts: indices of the parts.
        origin_m: the body's origin [3] in the twin's axes.
        axes: the body's axes as rows [3, 3]; by default the twin's.
        shafts: indices of motors of which only the turning output is drawn; it is left out
            otherwise.
    """
    body_axes = np.eye(3) if axes is None else axes
    frame = body_axes @ TO_TWIN
    shift_mm = body_axes @ origin_m * 1000
    placed_parts = [plan.parts[part] for part in parts]
    motors = [plan.parts[motor] for motor in shafts]
    shapes: list[tuple[str, Shape]] = []
    # Our solids decide what hides what, which would be wrong for the shapes of an installed
    # library.
    can_hide = ldraw_library.folder() is None
    for placed in placed_parts:
        near = _touching(placed, placed_parts) if can_hide else []
        shapes += _moved(
            placed,
            near,
            frame,
            shift_mm,
            only_turning=False,
        )
    # A shaft turns, so what hides it now will not hide it later.
    for motor in motors:
        shapes += _moved(
            motor,
            [],
            frame,
            shift_mm,
            only_turning=True,
        )
    return Piece(tuple(shapes))


def _moved(
    placed: Placed,
    others: list[Placed],
    frame: Floats,
    shift_mm: Floats,
    *,
    only_turning: bool,
) -> Iterator[tuple[str, Shape]]:
    """Coloured shapes of a part, mm, without what other parts hide. ``frame``: from the plan to the
    body [3, 3]."""
    turn = frame @ placed.rotation
    for colour, shape in _shapes(placed, only_turning=only_turning):
        visible = _uncovered(placed, shape, others)
        # Points [n, 3] are turned into the body's axes in LDU, and then counted from the body's
        # origin in mm.
        points = (visible.points @ turn.T + frame @ placed.position) * MM_PER_LDU - shift_mm
        if len(visible.faces):
            yield colour, Shape(points, visible.normals @ turn.T, visible.faces)


def _touching(placed: Placed, parts: Iterable[Placed]) -> list[Placed]:
    """The other parts whose bounds touch those of a part."""
    low, high = placed.bounds
    found = []
    for part in parts:
        other_low, other_high = part.bounds
        if part is not placed and (other_low <= high).all() and (low <= other_high).all():
            found.append(part)
    return found


def _uncovered(
    placed: Placed,
    shape: Shape,
    others: list[Placed],
) -> Shape:
    """A shape of a part without the triangles that other parts hide: those with material just
    outside of them."""
    samples = offset_points(placed.to_plan(shape.points)[shape.faces], _CLEARANCE)
    flat_samples = samples.reshape(-1, 3)
    is_covered = np.zeros(len(flat_samples), dtype=bool)
    for other in others:
        # Most samples are not even in the bounds of the other part.
        low, high = other.bounds
        is_near = ((low <= flat_samples) & (flat_samples <= high)).all(axis=1)
        asked = np.flatnonzero(is_near & ~is_covered)
        if not len(asked):
            continue
        points = other.to_part(flat_samples[asked])
        for solid in other.part.solids:
            is_covered[asked] |= solid.contains(points, 0.0)
    covered = is_covered.reshape(samples.shape[:2])
    # A triangle is removed only if all of its samples are hidden.
    visible = shape.faces[~covered.all(axis=1)]
    # The points that no triangle uses any more are removed too, and the faces are numbered anew.
    used, numbers = np.unique(visible, return_inverse=True)
    faces = numbers.reshape(visible.shape).astype(np.int32)
    return Shape(shape.points[used], shape.normals[used], faces)


def _shapes(placed: Placed, *, only_turning: bool) -> list[tuple[str, Shape]]:
    """Coloured shapes of a part in its frame, in LDraw units."""
    main = colour_of(placed.colour).rgb
    # The best drawing is tried first: an installed library, then ours in detail, then the
    # catalogue. Only the catalogue knows which of a motor's solids turn.
    root = ldraw_library.folder()
    if root is not None and not only_turning:
        from_library = _of_library(placed.part, root)
        if from_library:
            return [(colour or colour_name(main), shape) for colour, shape in from_library]
    if not only_turning:
        detailed = _detailed(placed.part)
        if detailed:
            return detailed
    device = placed.part.device
    is_motor = device is not None and device.kind is DeviceKind.MOTOR
    shown = []
    for tint, shape in _of_catalogue(placed.part).items():
        # The case and the output of a motor are on different bodies, so each is drawn without the
        # other.
        is_drawn = not is_motor or only_turning is (tint is Tint.TURNING)
        if is_drawn:
            shown.append((colour_name(TINTS.get(tint, main)), shape))
    return shown


@functools.lru_cache(maxsize=512)
def _of_catalogue(part: Part) -> dict[Tint, Shape]:
    """Our shapes of a part."""
    surface = surface_of(part)
    low, high = part.bounds
    # The part is smaller by the clearance between parts, so that no two surfaces coincide and
    # flicker.
    scale = 1.0 - _CLEARANCE / np.maximum(high - low, 10.0)
    triangles = surface.triangles * scale
    shapes = {}
    for tint in Tint:
        shape = shape_of(triangles[surface.tints == int(tint)])
        if shape is not None:
            shapes[tint] = shape
    return shapes


@functools.lru_cache(maxsize=64)
def _detailed(part: Part) -> list[tuple[str, Shape]]:
    """Our detailed shapes of a hub, motor, sensor or wheel, without a motor's output; empty if
    there are none."""
    device = part.device.name if part.device is not None else ""
    if device in _DETAILED:
        make, axes = _DETAILED[device]
        drawing = make()
    elif part.wheel_mm > _SPOKED_MM:
        drawing = pieces.wheel(part.wheel_mm)
        axes = _WHEEL_AXES
    else:
        return []
    turn = _rotation_to_drawing(axes)
    all_points_mm = np.concatenate([shape.points for _, shape in drawing.shapes])  # [n, 3]
    points = all_points_mm @ turn / MM_PER_LDU
    low, high = part.bounds
    if device:
        # The drawing leaves out what turns, so it is fitted to the case alone, which is the first
        # solid.
        case = part.solids[0].corners()
        low = case.min(axis=0)
        high = case.max(axis=0)
    # The origins of the drawing and of the catalogue differ, so their middles are laid on each
    # other.
    shift = (low + high - points.min(axis=0) - points.max(axis=0)) / 2
    placed = []
    for colour, shape in drawing.shapes:
        local = shape.points @ turn / MM_PER_LDU + shift
        placed.append((colour, Shape(local, shape.normals @ turn, shape.faces)))
    return placed


def _rotation_to_drawing(axes: tuple[int, int, int]) -> Floats:
    """Rotation [3, 3] from a part's axes to those of a drawing, which are signed axes of the
    part."""
    turn = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        # Axes are numbered from 1, because 0 has no sign that could say a direction.
        turn[row, abs(axis) - 1] = np.sign(axis)
    return turn


@functools.lru_cache(maxsize=256)
def _of_library(part: Part, root: Path) -> tuple[tuple[str, Shape], ...]:
    """Shapes of a part in an LDraw library by colour, "" for its main colour; empty if it has
    none."""
    # The library may know a part by another number than this catalogue.
    by_colour: ldraw_library.Triangles = {}
    for number in (part.number, *part.aliases):
        by_colour = ldraw_library.triangles_of(root, f"{number}.dat")
        if by_colour:
            break
    shapes = []
    for code, triangles in by_colour.items():
        shape = shape_of(triangles)
        if shape is None:
            continue
        is_main = code == ldraw_library.MAIN_COLOUR
        name = "" if is_main else colour_name(ldraw_library.rgba(root, code))
        shapes.append((name, shape))
    return tuple(shapes)


def cables_of(
    plan: Plan,
    parts: Iterable[int],
    origin_m: Floats,
) -> list[Piece]:
    """Cables between the hub and the motors and sensors on the same body, in that body's frame,
    mm."""
    devices = [plan.parts[part] for part in parts if plan.parts[part].part.device is not None]
    hubs = [placed for placed in devices if placed.electric.kind is DeviceKind.HUB]
    if not hubs:
        return []
    hub = hubs[0]
    sockets = dict(hub.electric.ports)
    cables = []
    for placed in devices:
        if placed is hub or placed.port not in sockets:
            continue
        socket = np.array(sockets[placed.port])
        plug = np.array(placed.electric.plug)
        # A Bezier curve leaves both of its ends straight, which lets a cable come straight out of
        # the hub's side and of the device's back.
        outward = _BEND * _outward(hub, socket)
        back = np.sign(plug) * [0.0, 0.0, _BEND]
        at_hub = hub.to_plan(np.stack([socket, socket + outward]))
        at_device = placed.to_plan(np.stack([plug + back, plug]))
        line = np.concatenate([at_hub, at_device])  # [4, 3], LDU
        line_mm = line @ TO_TWIN.T * MM_PER_LDU - origin_m * 1000
        cables.append(pieces.cable([(x, y, z) for x, y, z in line_mm.tolist()]))
    return cables


def _outward(hub: Placed, socket: Floats) -> Floats:
    """Direction [3] out of the side of a hub that a socket is in, in the hub's frame."""
    low, high = hub.part.bounds
    share = (socket - (low + high) / 2) / (high - low)
    side = int(np.argmax(abs(share)))
    outward = np.zeros(3)
    outward[side] = np.sign(share[side])
    return outward
