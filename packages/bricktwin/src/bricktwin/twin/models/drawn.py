"""Looks of models: one mesh for each body and colour, which keeps rendering fast, without mass or contact."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from bricktwin.plans.drawings import COLOURS, GLOWING, Piece
from bricktwin.plans.shapes import Shape, merge
from bricktwin.twin.models.mjcf import LOOKS


def add_colours(spec: mujoco.MjSpec) -> None:
    """Add materials for all colours."""
    for name, rgb in COLOURS.items():
        emission = 0.6 if name in GLOWING else 0.0
        spec.add_material(name=name, rgba=[*rgb, 1.0], specular=0.35, shininess=0.5, emission=emission)


def draw(spec: mujoco.MjSpec, body: mujoco.MjsBody, parts: Sequence[Piece]) -> None:
    """Draw parts, given in millimetres in the body's frame: one mesh per colour, without mass or contact.

    The model's materials have the names of the colours; the material of a colour ``"#rrggbbaa"`` is created here.
    """
    by_colour: dict[str, list[Shape]] = {}
    for part in parts:
        for colour, shape in part.shapes:
            by_colour.setdefault(colour, []).append(shape)
    for colour, shapes in by_colour.items():
        if colour.startswith("#") and spec.material(colour) is None:
            rgba = [value / 255 for value in bytes.fromhex(colour[1:])]
            spec.add_material(name=colour, rgba=rgba, specular=0.35, shininess=0.5)
        shape, name = merge(shapes), f"{body.name}_{colour}"
        spec.add_mesh(
            name=name,
            uservert=(shape.points / 1000).ravel().tolist(),
            usernormal=shape.normals.ravel().tolist(),
            userface=shape.faces.ravel().tolist(),
            userfacenormal=shape.faces.ravel().tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=colour, mass=0, **LOOKS)
