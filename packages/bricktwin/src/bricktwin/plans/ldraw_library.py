"""Reader of parts, as triangles, from an LDraw library (https://www.ldraw.org) on this computer.

It implements the LDraw.org file format with its colour definition (``LDConfig.ldr``) and back face
culling extensions. A part is a tree of files; what is missing or malformed is left out.
"""

import functools
import logging
import os
import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bricktwin.plans.catalogue import DIRECT_COLOUR, colour_of
from bricktwin.plans.geometry import Floats
from bricktwin.plans.ldraw_file import colour_and_numbers
from bricktwin.plans.ldraw_text import key_of

Triangles = dict[int, Floats]
"""Triangles [n, 3, 3] by colour code, counter-clockwise seen from outside."""

MAIN_COLOUR = 16
"""Code of the colour that is chosen where the part is used."""

_SYSTEM_FOLDERS = ("/usr/share/ldraw", "/usr/local/share/ldraw", "/Library/LDraw", "C:/LDraw")
"""Folders in which Linux, macOS and Windows keep such a library."""
_NUMBERS = {"1": 12, "3": 9, "4": 12}
"""Count of the numbers of a line that refers to a file, or is a triangle or a quadrilateral."""
_COLOUR = re.compile(
    r"0 !COLOUR\s+\S+\s+CODE\s+(\d{1,9})\s+VALUE\s+#([0-9A-Fa-f]{6})\b(?:.*\bALPHA\s+(\d{1,3})\b)?"
)
_log = logging.getLogger(__name__)


def folder() -> Path | None:
    """Folder of an installed LDraw library: ``LDRAWDIR``, else a system folder; ``None`` if there
    is none."""
    path = os.environ.get("LDRAWDIR")
    if path and not _is_library(Path(path)):
        _log.warning(
            "LDRAWDIR=%s is not an LDraw library (a folder with LDConfig.ldr, parts and p); "
            "using our own parts",
            path,
        )
        return None
    for candidate in (path,) if path else _SYSTEM_FOLDERS:
        if _is_library(Path(candidate)):
            return Path(candidate)
    return None


def _is_library(path: Path) -> bool:
    return (path / "LDConfig.ldr").is_file() and (path / "parts").is_dir()


def triangles_of(root: Path, name: str) -> Triangles:
    """Triangles of a file of the library in a folder, such as ``"37316.dat"``, in LDraw units: 0.4
    mm, y downwards. Empty if there is no such file, or it is part of itself."""
    try:
        return _triangles_of(root, name)
    except RecursionError:
        _log.warning("%s in the LDraw library %s is part of itself; it is left out", name, root)
        return {}


@functools.lru_cache(maxsize=4096)
def _triangles_of(root: Path, name: str) -> Triangles:
    pieces: dict[int, list[Floats]] = defaultdict(list)
    # LDraw's language extension for back face culling (BFC) says on which side a triangle is seen;
    # this is its state.
    certified = False
    clockwise = False
    inverted = False
    for line in _text(root, name).splitlines():
        words = line.split()
        if words[:2] == ["0", "BFC"]:
            # By the specification, naming a winding certifies a file as well.
            says_winding = bool({"CERTIFY", "CW", "CCW"} & set(words))
            certified = "NOCERTIFY" not in words and (certified or says_winding)
            clockwise = "CW" in words or (clockwise and "CCW" not in words)
            inverted = "INVERTNEXT" in words
            continue
        drawn = None
        if words and words[0] in _NUMBERS:
            drawn = colour_and_numbers(words, _NUMBERS[words[0]])
        if drawn is not None:
            colour, numbers = drawn
            if words[0] == "1":
                file_name = key_of(" ".join(words[14:]))
                inner = _triangles_of(root, file_name)
                for code, triangles in _placed(inner, numbers, inverted=inverted).items():
                    # The main colour of a file is whatever colour the file is placed in.
                    pieces[colour if code == MAIN_COLOUR else code].append(triangles)
            else:
                pieces[colour].append(_faces(numbers, clockwise=clockwise, certified=certified))
        # INVERTNEXT holds for the next line that is not empty.
        inverted = inverted and not words
    return {colour: np.concatenate(triangles) for colour, triangles in pieces.items()}


def _placed(
    inner: Triangles,
    numbers: Sequence[float],
    *,
    inverted: bool,
) -> Triangles:
    """Triangles of a file in the frame of the file that places it. ``numbers``: offset and matrix
    of the line that does."""
    offset = np.array(numbers[:3])
    matrix = np.array(numbers[3:]).reshape(3, 3)
    # A mirrored part has its triangles inside out, so they are turned over once more.
    is_flipped = inverted != bool(np.linalg.det(matrix) < 0)
    placed: Triangles = {}
    for code, local in inner.items():
        triangles = local @ matrix.T + offset
        placed[code] = triangles[:, ::-1] if is_flipped else triangles
    return placed


def _faces(
    numbers: Sequence[float],
    *,
    clockwise: bool,
    certified: bool,
) -> Floats:
    """Triangles [n, 3, 3] of a triangle or a quadrilateral."""
    corners = np.array(numbers).reshape(-1, 3)
    faces = corners[None, :]
    if len(corners) == 4:
        faces = corners[[[0, 1, 2], [0, 2, 3]]]
    if clockwise:
        faces = faces[:, ::-1]
    # Where the winding is undefined both sides are drawn, because either may be the outer one.
    return faces if certified else np.concatenate([faces, faces[:, ::-1]])


def _text(root: Path, name: str) -> str:
    # Parts are in the first folder, and the primitives that they are made of in the second.
    for path in (root / "parts" / name, root / "p" / name):
        if path.is_file():
            return path.read_text(encoding="utf-8", errors="replace")
    return ""


def rgba(root: Path, code: int) -> tuple[float, float, float, float]:
    """Colour of a code in the library, as RGBA in 0..1; medium grey if undefined."""
    if code >= DIRECT_COLOUR:
        return (*colour_of(code).rgb, 1.0)
    return _colours(root).get(code, (0.5, 0.5, 0.5, 1.0))


@functools.lru_cache(maxsize=2)
def _colours(root: Path) -> dict[int, tuple[float, float, float, float]]:
    colours = {}
    text = (root / "LDConfig.ldr").read_text(encoding="utf-8", errors="replace")
    for line in text.splitlines():
        match = _COLOUR.match(line)
        if match:
            red, green, blue = bytes.fromhex(match[2])
            alpha = min(int(match[3] or 255), 255)
            colours[int(match[1])] = (red / 255, green / 255, blue / 255, alpha / 255)
    return colours
