"""A tiny LDraw library with boxes of our own."""

from __future__ import annotations

from pathlib import Path

COLOURS = (
    "0 !COLOUR White CODE 15 VALUE #FFFFFF EDGE 0\n"
    "0 !COLOUR Glass CODE 47 VALUE #10C020 EDGE 0 ALPHA 128\n"
)
HALF_SIZES = {"67718p01": (70, 40, 110), "37316": (70, 30, 32), "54696p02": (30, 40, 90)}
"""Sizes along x, y, z in LDraw units."""

_SIDES = """0 BFC CERTIFY CCW
4 16 -1 -1 -1 1 -1 -1 1 -1 1 -1 -1 1
4 16 -1 1 -1 -1 1 1 1 1 1 1 1 -1
4 16 -1 -1 -1 -1 1 -1 1 1 -1 1 -1 -1
4 16 -1 -1 1 1 -1 1 1 1 1 -1 1 1
4 16 -1 -1 -1 -1 -1 1 -1 1 1 -1 1 -1
4 16 1 -1 -1 1 1 -1 1 1 1 1 -1 1
"""


def placed(
    name: str, colour: int = 16, size: tuple[float, float, float] = (1, 1, 1), offset: str = "0 0 0"
) -> str:
    """A line that places another file."""
    x, y, z = size
    return f"1 {colour} {offset} {x} 0 0 0 {y} 0 0 0 {z} {name}\n"


def write_library(root: Path, **parts: str) -> Path:
    """A library with given parts by file name; ``box8`` is a cube of 2 x 2 x 2."""
    for folder in ("parts", "p"):
        (root / folder).mkdir(parents=True)
    (root / "LDConfig.ldr").write_text(COLOURS)
    (root / "p" / "box8.dat").write_text(_SIDES)
    for name, text in parts.items():
        (root / "parts" / f"{name}.dat").write_text(text)
    return root


def write_robot_parts(root: Path) -> Path:
    """A library with boxes for hub, distance sensor and motor; the hub has a green window."""
    parts = {
        name: "0 BFC CERTIFY CCW\n" + placed("box8.dat", size=size)
        for name, size in HALF_SIZES.items()
    }
    parts["67718p01"] += placed("box8.dat", 47, (30, 2, 30), "0 -39 0")
    return write_library(root, **parts)
