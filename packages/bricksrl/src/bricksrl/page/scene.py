"""Scene of named bodies in 3D for a browser: constant meshes, variable poses. Metres, z up.

A scene is sent once, as one binary file; after that only poses are sent. This module knows no
robots and loads neither MuJoCo nor torch: it shows twins (:mod:`bricksrl.page.robot_view`) and
building plans alike.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import PageError

if TYPE_CHECKING:
    from bricktwin.plans.drawing.shapes import Shape as LegoShape

Floats = NDArray[np.float32]
Triple = tuple[float, float, float]
Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each in 0..1."""
Quaternion = tuple[float, float, float, float]
"""Unit quaternion w, x, y, z."""

NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)
HIDDEN = math.nan
"""Value of x in a body's pose that hides the body."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangle mesh with a normal at each point. Raises PageError if the arrays' shapes do not
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
            raise PageError(
                "a mesh needs points and normals [n, 3] and faces [m, 3]; give arrays of "
                "these shapes"
            )
        if len(self.faces) and not 0 <= int(self.faces.min()) <= int(self.faces.max()) < count:
            raise PageError(
                f"a mesh of {count} points has a face with another one; give numbers below {count}"
            )


@dataclass(frozen=True)
class Shape:
    """Coloured mesh with a pose in its body's frame. ``pattern`` is "" or "bricks"."""

    mesh: Mesh
    colour: Colour
    position: Triple = (0.0, 0.0, 0.0)
    wxyz: Quaternion = NO_TURN
    pattern: str = ""


@dataclass(frozen=True)
class SceneBody:
    """Rigid body with its shapes."""

    name: str
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class View:
    """Initial pose of the camera.

    Attributes:
        target: point that it looks at.
        distance_m: distance of the camera from the target.
        yaw_deg, pitch_deg: direction of the camera from the target, counter-clockwise from x seen
            from above, and elevation.
        follow: number of the body that it follows; ``None`` for a fixed camera.
        ratio: width over height of what is to be seen; a narrower window shows it smaller.
    """

    target: Triple = (0.0, 0.0, 0.05)
    distance_m: float = 0.6
    yaw_deg: float = -55.0
    pitch_deg: float = 25.0
    follow: int | None = None
    ratio: float = 10 / 9


@dataclass(frozen=True)
class Scene:
    """Bodies, height of the floor in metres (``None`` for none), and initial view."""

    bodies: tuple[SceneBody, ...]
    floor_m: float | None = 0.0
    view: View = field(default_factory=View)

    def to_bytes(self) -> bytes:
        """Binary file: the length of a JSON header (uint32), the header with the arrays' offsets,
        and the arrays.

        Arrays are little-endian: points float32, normals int8 with a fourth byte of padding, faces
        uint32. Their offsets after the header are multiples of 4 bytes.
        """
        # Equal parts share a mesh, which is sent once.
        numbers: dict[int, int] = {}
        meshes: list[Mesh] = []
        bodies = []
        for body in self.bodies:
            shapes = []
            for shape in body.shapes:
                if id(shape.mesh) not in numbers:
                    numbers[id(shape.mesh)] = len(meshes)
                    meshes.append(shape.mesh)
                shapes.append({**vars(shape), "mesh": numbers[id(shape.mesh)]})
            bodies.append({"name": body.name, "shapes": shapes})
        described: list[dict[str, int]] = []
        arrays = list[bytes]()
        length = 0
        for mesh in meshes:
            normals = np.zeros((len(mesh.points), 4), np.int8)
            normals[:, :3] = np.round(np.clip(mesh.normals, -1.0, 1.0) * 127)
            of_mesh = {
                "points": mesh.points.astype("<f4"),
                "normals": normals,
                "faces": mesh.faces.astype("<u4"),
            }
            about = {"vertices": len(mesh.points), "triangles": len(mesh.faces)}
            for name, array in of_mesh.items():
                about[name] = length
                arrays.append(array.tobytes())
                length += array.nbytes
            described.append(about)
        header = {
            "meshes": described,
            "bodies": bodies,
            "floor": self.floor_m,
            "view": vars(self.view),
        }
        text = json.dumps(header).encode()
        # A browser reads float32 at multiples of four bytes alone.
        text += b" " * (-len(text) % 4)
        return struct.pack("<I", len(text)) + text + b"".join(arrays)


def poses(
    positions: Sequence[Sequence[float]] | NDArray[np.floating], turns: object = None
) -> Floats:
    """Poses ``[bodies, 7]`` from positions ``[bodies, 3]`` (m) and quaternions ``[bodies, 4]`` (w,
    x, y, z), by default none.

    An x of :data:`HIDDEN` hides a body.
    """
    positions_m = np.asarray(positions, np.float32).reshape(-1, 3)
    count = len(positions_m)
    if turns is None:
        quaternions = np.tile(np.array(NO_TURN, np.float32), (count, 1))
    else:
        quaternions = np.asarray(turns, np.float32)
    return np.concatenate([positions_m, quaternions.reshape(-1, 4)], axis=1)


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
    from bricktwin.plans.drawing.shapes import block

    return mesh_of(block(2.0, 2.0, 2.0), half_size)
