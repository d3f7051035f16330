"""Worlds: a gallery of scenes by name, for every robot that drives.

Sizes are in millimetres; where a game has rules, the numbers are theirs, and its module says which.
"""

from collections.abc import Callable

from brickhub.errors import UnknownNameError, hint
from bricktwin.twin.scene import Scene
from bricktwin.worlds import courses, games, lines

WORLDS: dict[str, Callable[[], Scene]] = {
    "line-simple": lines.line_simple,
    "line-sharp": lines.line_sharp,
    "line-junctions": lines.line_junctions,
    "line-gaps": lines.line_gaps,
    "line-obstacles": lines.line_obstacles,
    "colors": lines.colors,
    "squares": courses.squares,
    "maze": courses.maze,
    "cans": courses.cans,
    "ramps": courses.ramps,
    "wall": courses.wall,
    "room": courses.room,
    "sumo": games.sumo,
    "football": games.football,
    "blocks": games.blocks,
    "table": games.table,
}
"""Functions that make a world, by its name; the docstring says what is there."""


def world(name: str) -> Scene:
    """The world of that name. Raises UnknownNameError if there is none."""
    try:
        return WORLDS[name]()
    except KeyError:
        raise UnknownNameError(
            f"there is no world '{name}'{hint(name, WORLDS)}; choose {', '.join(WORLDS)}"
        ) from None


def summary(name: str) -> str:
    """What is in a world, in one sentence."""
    text = WORLDS[name].__doc__ or ""
    first, _, _ = text.strip().partition("\n\n")
    return " ".join(first.split())
