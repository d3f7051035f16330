"""Reader of parts, as triangles, from an LDraw library (https://www.ldraw.org) on this computer.

It implements the LDraw.org file format with its colour definition (``LDConfig.ldr``) and back face culling extensions. A part is
a tree of files; unreadable ones are skipped, and nothing outside the library is opened.
"""

from __future__ import annotations

import functools
import logging
import os
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from brickhub.errors import TwinError
from bricktwin.plans.catalogue import DIRECT_COLOUR, colour_of
from bricktwin.plans.geometry import Floats
from bricktwin.plans.ldraw_file import colour_and_numbers, key_of

Triangles = dict[int, Floats]
"""Triangles [n, 3, 3] by colour code, counter-clockwise seen from outside."""

MAIN_COLOUR = 16
"""Code of the colour that is chosen where the part is used."""

_SYSTEM_FOLDERS = ("/usr/share/ldraw", "/usr/local/share/ldraw", "/Library/LDraw", "C:/LDraw")
_MAX_DEPTH = 24
_NUMBERS = {"1": 12, "3": 9, "4": 12}
"""Count of the numbers of a line that refers to a file, or is a triangle or a quadrilateral."""
_MAX_FILE_BYTES = 8_000_000
_MAX_TRIANGLES, _MAX_VISITS = 400_000, 20_000
_COLOUR = re.compile(r"0 !COLOUR\s+\S+\s+CODE\s+(\d{1,9})\s+VALUE\s+#([0-9A-Fa-f]{6})\b")
_ALPHA = re.compile(r"\bALPHA\s+(\d{1,3})\b")
_log = logging.getLogger(__name__)


class SubFile(NamedTuple):
    """Reference to another file: its colour, matrix [3, 3], offset [3], and whether it is inverted (inside out)."""

    colour: int
    matrix: Floats
    offset: Floats
    name: str
    inverted: bool


class _File(NamedTuple):
    references: list[SubFile]
    triangles: Triangles


def folder() -> Path | None:
    """Folder of an installed LDraw library: ``LDRAWDIR``, else a system folder; ``None`` if there is none."""
    path = os.environ.get("LDRAWDIR")
    if path and not _is_library(Path(path)):
        _log.warning("LDRAWDIR=%s is not an LDraw library (a folder with LDConfig.ldr, parts and p); using our own parts", path)
        return None
    candidates = (path,) if path else _SYSTEM_FOLDERS
    return next((Path(candidate) for candidate in candidates if _is_library(Path(candidate))), None)


def _is_library(path: Path) -> bool:
    return (path / "LDConfig.ldr").is_file() and (path / "parts").is_dir()


@functools.lru_cache(maxsize=2)
def library(root: Path) -> Library:
    """Library in a folder, cached."""
    return Library(root)


class Library:
    """LDraw library: parts and colours below a folder."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._colours = _read_colours(root / "LDConfig.ldr")
        self._files: dict[str, _File] = {}

    def rgba(self, code: int) -> tuple[float, float, float, float]:
        """Colour of a code, as RGBA in 0..1; medium grey if undefined."""
        if code >= DIRECT_COLOUR:
            return (*colour_of(code).rgb, 1.0)
        return self._colours.get(code, (0.5, 0.5, 0.5, 1.0))

    def part(self, name: str) -> Triangles:
        """Triangles of a part, such as ``"37316.dat"``, in LDraw units: 0.4 mm, y downwards. Raises TwinError if the library does
        not have the part, or it is empty or too large."""
        if self._path(name) is None:
            raise TwinError(f"the LDraw library in {self._root} has no part '{name}'; install a newer one")
        damaged = TwinError(f"'{name}' of the LDraw library in {self._root} cannot be drawn; reinstall the library")
        pieces: dict[int, list[Floats]] = defaultdict(list)
        count = 0
        with np.errstate(all="ignore"):
            for visits, drawn in enumerate(self._collect(name, MAIN_COLOUR, np.eye(3), np.zeros(3), False, ()), 1):
                for colour, triangles in drawn:
                    pieces[colour].append(triangles)
                    count += len(triangles)
                if count > _MAX_TRIANGLES or visits > _MAX_VISITS:
                    raise damaged
        merged = {colour: np.concatenate(own) for colour, own in pieces.items()}
        if not merged or not all(np.isfinite(triangles).all() for triangles in merged.values()):
            raise damaged
        return merged

    def _collect(
        self, name: str, colour: int, matrix: Floats, offset: Floats, inverted: bool, ancestors: tuple[str, ...]
    ) -> Iterator[list[tuple[int, Floats]]]:
        """Triangles of a file and of each of its references, transformed by ``matrix`` [3, 3] and ``offset`` [3], with their
        colours. Deep or cyclic references are left out."""
        if name in ancestors or len(ancestors) >= _MAX_DEPTH:
            return
        file, flipped = self._file(name), inverted != bool(np.linalg.det(matrix) < 0)
        drawn = [(colour if code == MAIN_COLOUR else code, local @ matrix.T + offset) for code, local in file.triangles.items()]
        yield [(code, triangles[:, ::-1] if flipped else triangles) for code, triangles in drawn]
        for ref in file.references:
            code, ref_offset = colour if ref.colour == MAIN_COLOUR else ref.colour, matrix @ ref.offset + offset
            yield from self._collect(
                ref.name, code, matrix @ ref.matrix, ref_offset, inverted != ref.inverted, (*ancestors, name)
            )

    def _file(self, name: str) -> _File:
        if name not in self._files:
            path = self._path(name)
            self._files[name] = _File([], {}) if path is None else parse(_text(path))
        return self._files[name]

    def _path(self, name: str) -> Path | None:
        """Path of a file; ``None`` if there is none, or if its name leads out of the library."""
        parts = PurePosixPath(name).parts
        if not parts or any(part == ".." or ":" in part or part.startswith("/") for part in parts):
            return None
        candidates = (self._root / folder / Path(*parts) for folder in ("parts", "p"))
        return next((path for path in candidates if path.is_file()), None)


def parse(text: str) -> _File:
    """Parse one file into triangles and references; malformed lines are skipped."""
    references: list[SubFile] = []
    triangles: dict[int, list[Floats]] = defaultdict(list)
    certified, clockwise, inverted = False, False, False
    for line in text.splitlines():
        words = line.split()
        if words[:2] == ["0", "BFC"]:
            certified = "NOCERTIFY" not in words and (certified or bool({"CERTIFY", "CW", "CCW"} & set(words)))
            clockwise = "CW" in words or (clockwise and "CCW" not in words)
            inverted = "INVERTNEXT" in words
            continue
        count = _NUMBERS.get(words[0]) if words else None
        drawn = None if count is None else colour_and_numbers(words, count)
        if drawn is not None:
            colour, numbers = drawn
            if words[0] == "1":
                matrix, offset = np.array(numbers[3:]).reshape(3, 3), np.array(numbers[:3])
                references.append(SubFile(colour, matrix, offset, key_of(" ".join(words[14:])), inverted))
            else:
                corners = np.array(numbers).reshape(-1, 3)
                faces = corners[None, :] if len(corners) == 3 else corners[[[0, 1, 2], [0, 2, 3]]]
                faces = faces[:, ::-1] if clockwise else faces
                # Of undefined winding, both sides are drawn.
                triangles[colour].append(faces if certified else np.concatenate([faces, faces[:, ::-1]]))
        inverted = inverted and not words  # only the next line
    return _File(references, {colour: np.concatenate(pieces) for colour, pieces in triangles.items()})


def _text(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(_MAX_FILE_BYTES)
    except OSError:
        return ""


def _read_colours(path: Path) -> dict[int, tuple[float, float, float, float]]:
    colours = {}
    for line in _text(path).splitlines():
        if match := _COLOUR.match(line):
            red, green, blue = bytes.fromhex(match[2])
            alpha = _ALPHA.search(line)
            opacity = min(int(alpha[1]), 255) / 255 if alpha else 1.0
            colours[int(match[1])] = (red / 255, green / 255, blue / 255, opacity)
    return colours
