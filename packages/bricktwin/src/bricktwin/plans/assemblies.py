"""Parts that LDraw composes of several lines: hubs and their batteries, motors and their shafts,
rims and tyres.

Some are one part here, and some are one line that is several parts here. Source of the numbers and
places: the shortcuts and assemblies of LDraw.org's part library, in ``assemblies.csv``.
"""

import functools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from brickhub.tables import read_table
from bricktwin.plans import catalogue
from bricktwin.plans.catalogue import part_notation
from bricktwin.plans.geometry import Floats
from bricktwin.plans.ldraw_file import Marks, Reference

_NEAR = 2.0
"""Largest distance of a piece from its place, LDU. Its direction is free, because shafts turn."""
_OWN_COLOUR = 16


class Piece(NamedTuple):
    """A line of an assembly.

    Attributes:
        number: of the part.
        place: in the frame of the assembly [3].
        colour: 16 for that of the assembly.
    """

    number: str
    place: Floats
    colour: int


class Assembly(NamedTuple):
    """A part that is composed.

    Attributes:
        number: of the whole.
        here: "whole" if its lines are one part here, "pieces" if its line is several, "either" if
            it is as it is drawn.
        pieces: the first one stands for the whole.
    """

    number: str
    here: str
    pieces: tuple[Piece, ...]


@functools.cache
def assemblies() -> tuple[Assembly, ...]:
    """The rows of ``assemblies.csv``."""
    return tuple(
        Assembly(row["number"], row["here"], tuple(map(_piece, row["pieces"].split())))
        for row in read_table("bricktwin.plans.catalogue", "assemblies")
    )


def _piece(text: str) -> Piece:
    """A piece of ``number@x,y,z`` or ``number@x,y,z#colour``."""
    number, _, place = text.partition("@")
    place, _, colour = place.partition("#")
    return Piece(
        number, np.array(part_notation.point(place or "0,0,0")), int(colour or _OWN_COLOUR)
    )


@functools.cache
def components() -> dict[str, tuple[str, ...]]:
    """The parts that a part of the catalogue is composed of, which may be drawn in its place."""
    return {
        assembly.number: tuple(catalogue.get(piece.number).number for piece in assembly.pieces)
        for assembly in assemblies()
        if assembly.here == "either"
    }


def is_known(name: str) -> bool:
    """Whether a name is that of a part of the catalogue, or of several."""
    return catalogue.find(name) is not None or name.lower().removesuffix(".dat") in _shortcuts()


@functools.cache
def _pieces() -> frozenset[str]:
    """Numbers of the lines that parts are composed of; none is a part of the catalogue."""
    wholes = [assembly for assembly in assemblies() if assembly.here == "whole"]
    return frozenset(piece.number for assembly in wholes for piece in assembly.pieces)


def is_piece(name: str) -> bool:
    """Whether a name is that of a line that a part of the catalogue is composed of."""
    return name.lower().removesuffix(".dat") in _pieces()


@functools.cache
def _shortcuts() -> dict[str, Assembly]:
    """Assemblies that are their pieces, by number."""
    return {assembly.number: assembly for assembly in assemblies() if assembly.here == "pieces"}


@functools.cache
def _wholes() -> dict[str, list[tuple[Assembly, Piece]]]:
    """Assemblies that are parts, by the number of their first piece, and that piece."""
    found = defaultdict(list)
    for assembly in assemblies():
        if assembly.here == "whole":
            first = assembly.pieces[0]
            found[first.number].append((assembly, first))
            number = catalogue.get(assembly.number).number
            found[number].append((assembly, first._replace(number=number, place=np.zeros(3))))
    return found


def composed(references: list[Reference]) -> list[Reference]:
    """The lines of a model, with one line for the pieces of each part that they compose, and with
    the pieces of shortcuts."""
    expanded: list[Reference] = []
    for reference in references:
        expanded += _expanded(reference)
    numbers = [_number(reference) for reference in expanded]
    # Most models hold no piece of a whole, so the search below is skipped for them.
    if not any(number in _wholes() for number in numbers):
        return expanded
    merged: set[int] = set()
    for index, number in enumerate(numbers):
        if index in merged:
            continue
        found: list[tuple[Reference, list[int]]] = []
        for assembly, first in _wholes().get(number, ()):
            whole = _whole(expanded[index], assembly, first)
            included = list(
                _included(
                    whole,
                    assembly,
                    expanded,
                    numbers,
                    merged | {index},
                )
            )
            if included or first is assembly.pieces[0]:
                found.append((whole, included))
        if not found:
            continue
        # Two kinds of hubs share one case, so the kind of which more pieces are found is taken.
        whole, included = max(found, key=lambda candidate: len(candidate[1]))
        expanded[index] = _with_marks(whole, [expanded[other] for other in included])
        merged.update(included)
    return [reference for index, reference in enumerate(expanded) if index not in merged]


def is_composed(reference: Reference) -> bool:
    """Whether a line is a part that may be drawn as several lines."""
    return _number(reference) in _wholes()


def completed(
    wholes: Sequence[Reference], others: Sequence[Reference]
) -> list[tuple[Reference, list[int]]]:
    """Each part that may be drawn as several lines, with the pieces of it that other models place.

    Args:
        wholes: the parts, as `composed` gives them, at their places in the plan.
        others: lines of any models at their places in the plan.

    Returns:
        The part, of the kind that most of these pieces are of, and the indices of its pieces.
    """
    numbers = [_number(reference) for reference in others]
    taken: set[int] = set()
    found: list[tuple[Reference, list[int]]] = []
    for reference in wholes:
        best = reference
        best_pieces: list[int] = []
        for whole, assembly in _kinds_of(reference):
            pieces = list(
                _included(
                    whole,
                    assembly,
                    others,
                    numbers,
                    set(taken),
                )
            )
            # The kind that the file names is tried first, and gives way only to one with more
            # pieces.
            if len(pieces) > len(best_pieces):
                best = whole
                best_pieces = pieces
        taken.update(best_pieces)
        found.append((_with_marks(best, [others[index] for index in best_pieces]), best_pieces))
    return found


def _kinds_of(reference: Reference) -> Iterator[tuple[Reference, Assembly]]:
    """A part as each kind that begins with the same piece, its own first: two kinds of hubs have
    the same case."""
    for own, first in _wholes()[_number(reference)]:
        yield _whole(reference, own, first), own
        begin = own.pieces[0]
        # The offset is measured at the case, because all of these kinds have the same case.
        case_offset = reference.matrix @ begin.place + reference.offset
        case = replace(reference, name=f"{begin.number}.dat", offset=case_offset)
        for other, other_first in _wholes()[begin.number]:
            if other is not own:
                yield _whole(case, other, other_first), other


def _number(reference: Reference) -> str:
    """Number of the part that a line places: the catalogue's, if it is there under another one."""
    number = reference.name.lower().removesuffix(".dat")
    part = catalogue.find(number)
    return number if part is None else part.number


def _expanded(reference: Reference) -> Iterator[Reference]:
    """The pieces of a shortcut, or the line itself."""
    shortcut = _shortcuts().get(reference.name.lower().removesuffix(".dat"))
    if shortcut is None:
        yield reference
        return
    for number, piece in enumerate(shortcut.pieces):
        offset = reference.matrix @ piece.place + reference.offset
        colour = reference.colour if piece.colour == _OWN_COLOUR else piece.colour
        # Comments of ours describe a single part, so they belong to the first piece only.
        marks = reference.marks if number == 0 else Marks().marks
        yield replace(
            reference,
            name=f"{piece.number}.dat",
            offset=offset,
            colour=colour,
            **marks,
        )


def _whole(
    reference: Reference,
    assembly: Assembly,
    first: Piece,
) -> Reference:
    """The line of the whole part to which a first piece belongs."""
    offset = reference.offset - reference.matrix @ first.place
    # The first piece and the whole may share a number, which then is already in the catalogue.
    is_known_part = catalogue.find(reference.name) is not None
    name = reference.name if is_known_part else f"{assembly.number}.dat"
    return replace(reference, name=name, offset=offset)


def _included(
    whole: Reference,
    assembly: Assembly,
    references: Sequence[Reference],
    numbers: Sequence[str],
    taken: set[int],
) -> Iterator[int]:
    """Indices of the lines that are the further pieces of a part at its place."""
    for piece in assembly.pieces:
        place = whole.matrix @ piece.place + whole.offset
        for index, number in enumerate(numbers):
            if number != piece.number or index in taken:
                continue
            if np.abs(references[index].offset - place).max() < _NEAR:
                yield index
                taken.add(index)
                break


def _with_marks(whole: Reference, pieces: Sequence[Reference]) -> Reference:
    """A part with the marks from our comments on it, or on one of its pieces."""
    for piece in pieces:
        if whole.port is None and piece.port is not None:
            whole = replace(
                whole,
                port=piece.port,
                device=piece.device,
                angle_deg=piece.angle_deg,
            )
        if whole.stops_deg is None:
            whole = replace(whole, stops_deg=piece.stops_deg)
    return whole
