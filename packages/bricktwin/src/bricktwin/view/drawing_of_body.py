"""Drawing of named bodies in 3D for a browser: constant meshes, variable poses. Metres, z up.

A drawing is loaded once, as JSON; after that only frames follow: poses of its bodies, in its order.
This module knows no robots and no MuJoCo: it describes bodies (:mod:`bricktwin.view.body_drawing`)
and building plans alike. ``static/scene3d.js`` draws it, ``static/frames.js`` makes frames from
what MuJoCo's JavaScript build computes; ``docs/drawing.md`` has the format.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from bricktwin.plans.drawing.shapes import Shape as LegoShape
from bricktwin.plans.drawing.shapes import block

Floats = NDArray[np.float32]
Triple = tuple[float, float, float]
Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each in 0..1."""
Quaternion = tuple[float, float, float, float]
"""Unit quaternion w, x, y, z."""

T = TypeVar("T")
NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)
HIDDEN = math.nan
"""Value of x in a body's pose that hides the body."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangle mesh with a normal at each point. Raises TwinError if the arrays' shapes do not
    match, or a face index is out of range.

    Attributes:
        points, normals: float32 ``[n, 3]``.
        faces: int ``[m, 3]``, counter-clockwise from outside.
    """

    points: Floats
    normals: Floats
    faces: NDArray[np.integer]

    def __post_init__(self) -> None:
        count = len(self.points)
        has_points = self.points.shape == (count, 3)
        has_normals = self.normals.shape == (count, 3)
        has_faces = self.faces.shape == (len(self.faces), 3)
        if not (has_points and has_normals and has_faces):
            raise TwinError(
                "a mesh needs points and normals [n, 3] and faces [m, 3]; give arrays of "
                "these shapes"
            )
        if not len(self.faces):
            return
        lowest = int(self.faces.min())
        highest = int(self.faces.max())
        if lowest < 0 or highest >= count:
            raise TwinError(
                f"a mesh of {count} points has a face with another one; give numbers below {count}"
            )

    def described(self) -> dict[str, str]:
        """Its arrays for JSON, little-endian, in base64: points float32, normals int8 with a fourth
        byte of padding, faces uint32."""
        normals = np.zeros((len(self.points), 4), np.int8)
        normals[:, :3] = np.round(np.clip(self.normals, -1.0, 1.0) * 127)
        return {
            "points": _text(self.points.astype("<f4")),
            "normals": _text(normals),
            "faces": _text(self.faces.astype("<u4")),
        }


@dataclass(frozen=True)
class Shape:
    """Coloured mesh with a pose in its body's frame.

    Attributes:
        pattern: "" or "bricks".
        picture: PNG file that is stretched over the mesh, seen from its z axis, its upper edge at
            the largest y; ``None`` for the colour alone.
    """

    mesh: Mesh
    colour: Colour
    position: Triple = (0.0, 0.0, 0.0)
    wxyz: Quaternion = NO_TURN
    pattern: str = ""
    picture: bytes | None = None


@dataclass(frozen=True)
class DrawnBody:
    """Rigid body with its shapes.

    Attributes:
        model_body: its number in the MuJoCo model that moves it; ``None`` for what no model moves.
    """

    name: str
    shapes: tuple[Shape, ...]
    model_body: int | None = None


@dataclass(frozen=True)
class Spinner:
    """Shaft or gear that is turned for the eye only, with a joint.

    Attributes:
        body, parent: numbers of its body and of the one that carries it, in the model.
        address: of the joint's position in ``qpos``; ``start_rad``: its value without a turn.
        ratio: its turns for each of the joint; ``axis``: in its own frame.
    """

    body: int
    parent: int
    address: int
    start_rad: float
    ratio: float
    axis: Triple


@dataclass(frozen=True)
class Rod:
    """Rod that is turned for the eye only: from its body's origin to a site.

    Attributes:
        body, parent: numbers of its body and of the one that carries it, in the model.
        far_site: number of the site.
    """

    body: int
    parent: int
    far_site: int


@dataclass(frozen=True)
class View:
    """Initial pose of the camera.

    Attributes:
        target: point that it looks at.
        distance_m: distance of the camera from the target.
        yaw_deg, pitch_deg: direction of the camera from the target, counter-clockwise from x seen
            from above, and elevation.
        follow: number of the drawn body that it follows; ``None`` for a fixed camera.
        ratio: width over height of what is to be seen; a narrower window shows it smaller.
    """

    target: Triple = (0.0, 0.0, 0.05)
    distance_m: float = 0.6
    yaw_deg: float = -55.0
    pitch_deg: float = 25.0
    follow: int | None = None
    ratio: float = 10 / 9


@dataclass(frozen=True)
class Drawing:
    """Bodies in the order of a frame's poses.

    Attributes:
        floor_m: height of the floor in metres; ``None`` for none.
        view: initial view.
        spinners, rods: what a model does not turn itself.
    """

    bodies: tuple[DrawnBody, ...]
    floor_m: float | None = 0.0
    view: View = field(default_factory=View)
    spinners: tuple[Spinner, ...] = ()
    rods: tuple[Rod, ...] = ()

    def described(self) -> dict[str, Any]:
        """The drawing in plain values, for JSON."""
        # Equal parts share a mesh, which is sent once; so do equal pictures.
        meshes = _Numbered[Mesh]()
        pictures = _Numbered[bytes]()
        bodies = []
        for body in self.bodies:
            shapes = []
            for shape in body.shapes:
                plain = {
                    "mesh": meshes.number(id(shape.mesh), shape.mesh),
                    "colour": shape.colour,
                    "position": shape.position,
                    "wxyz": shape.wxyz,
                    "pattern": shape.pattern,
                    "picture": None,
                }
                if shape.picture is not None:
                    plain["picture"] = pictures.number(hash(shape.picture), shape.picture)
                shapes.append(plain)
            bodies.append({"name": body.name, "model_body": body.model_body, "shapes": shapes})
        encoded = [base64.b64encode(picture) for picture in pictures.items]
        return {
            "meshes": [mesh.described() for mesh in meshes.items],
            "pictures": [text.decode() for text in encoded],
            "bodies": bodies,
            "floor": self.floor_m,
            "view": asdict(self.view),
            "spinners": list(map(asdict, self.spinners)),
            "rods": list(map(asdict, self.rods)),
        }


class _Numbered(Generic[T]):
    """Different items, numbered as they come."""

    def __init__(self) -> None:
        self.items: list[T] = []
        self._numbers: dict[int, int] = {}

    def number(self, key: int, item: T) -> int:
        """Number of the item with this key."""
        if key not in self._numbers:
            self._numbers[key] = len(self.items)
            self.items.append(item)
        return self._numbers[key]


def _text(array: NDArray[Any]) -> str:
    return base64.b64encode(array.tobytes()).decode()


def poses(
    positions: Sequence[Sequence[float]] | NDArray[np.floating], turns: object = None
) -> Floats:
    """Frame: poses ``[bodies, 7]`` from positions ``[bodies, 3]`` (m) and quaternions ``[bodies,
    4]`` (w, x, y, z), by default none.

    An x of :data:`HIDDEN` hides a body.
    """
    positions_m = np.asarray(positions, np.float32).reshape(-1, 3)
    count = len(positions_m)
    if turns is None:
        quaternions = np.tile(np.array(NO_TURN, np.float32), (count, 1))
    else:
        quaternions = np.asarray(turns, np.float32)
    quaternions = quaternions.reshape(-1, 4)
    return np.concatenate([positions_m, quaternions], axis=1)


# --------------------------------------------------- meshes, by the same code as the looks of twins


def mesh_of(shape: LegoShape, scale: float | Triple = 1.0) -> Mesh:
    """Mesh of a drawn shape, larger by a factor, or by one along each axis."""
    factors = np.array(scale)
    points = shape.points * factors
    # Normals go by the inverse of the factors, as those of a stretched sphere turn away from it.
    normals = shape.normals / factors
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(points.astype(np.float32), normals.astype(np.float32), shape.faces)


def box(half_size: Triple) -> Mesh:
    """Box around the origin."""
    return mesh_of(block(2.0, 2.0, 2.0), half_size)


def rectangle(half_x_m: float, half_y_m: float) -> Mesh:
    """Rectangle around the origin, seen from its z axis."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    points = corners * np.array((half_x_m, half_y_m, 1.0), np.float32)
    normals = np.tile(np.array((0, 0, 1), np.float32), (4, 1))
    return Mesh(points, normals, np.array([(0, 1, 2), (0, 2, 3)]))
