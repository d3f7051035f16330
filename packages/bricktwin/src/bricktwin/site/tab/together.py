"""Robots that share a world, put together in a tab: each robot has a file of its own, and so has
each world, as a file for all that can meet in all worlds would be too many.

A file has the sections of an MJCF text, in which what depends on the others is a mark, and numbers
of the compiled model that are more exact than the text. MuJoCo numbers parts by their bodies, in
the order of the text, so that the numbers of the whole are those of its parts, one after the other:
the world itself, the robots, and what can be pushed.
"""

import json
from collections.abc import Sequence
from typing import Any

NAME = "@/"
"""Mark of a robot's name, which begins the names of its parts."""
TYPE = "@type"
"""Mark of the bits of contact of a robot's geometries, and of those that they answer to."""
ANSWERED = "@answered"
GROUP = "@group:"
"""Mark of a motor's circuit; its number among the robot's motors follows, and a colon."""
SECTIONS = (
    "asset",
    "worldbody",
    "contact",
    "tendon",
    "equality",
    "actuator",
    "sensor",
)
_DENSE_FROM_DOFS = 60
"""Degrees of freedom from which on MuJoCo chooses sparse matrices, whose factor is wrong there; see
``kept_models``."""

Part = dict[str, Any]


def put_together_text(robots: str, world: str) -> str:
    """As :func:`put_together`, of JSON and to JSON."""
    return json.dumps(put_together(json.loads(robots), json.loads(world)))


def put_together(robots: Sequence[Part], world: Part) -> Part:
    """A file of robots in a world: ``robots`` and ``scene`` as plain values, ``mjcf``, and
    ``pieces``, numbers of the compiled model, each with its field and the first place there.

    Args:
        robots: file of each robot, in the order of their hubs.
        world: file of the world.
    """
    texts = []
    motors = 0
    for number, part in enumerate(robots):
        texts.append(_sections_of(part, number, len(robots), motors))
        motors += part["motors"]
    sections = []
    for name in SECTIONS:
        inner = "".join(text.get(name, "") for text in texts)
        # What is fixed is a part of the world's body; what can be pushed comes after the robots.
        before, after = world["sections"].get(name, ("", ""))
        if before or inner or after:
            sections.append(f"<{name}>{before}{inner}{after}</{name}>")
    dofs = sum(part["lengths"].get("dof_armature", 0) for part in (*robots, world))
    dense = ' jacobian="dense"' if dofs >= _DENSE_FROM_DOFS else ""
    head = world["head"].replace("<option", f"<option{dense}")
    return {
        "robots": [part["robot"] for part in robots],
        "scene": world["scene"],
        "mjcf": f'<mujoco model="arena">{head}{"".join(sections)}</mujoco>',
        "pieces": _pieces(robots, world),
    }


def _sections_of(
    part: Part,
    number: int,
    count: int,
    motors: int,
) -> dict[str, str]:
    """Sections of a robot that is one of so many, after so many motors of others."""
    # Bit 0 is that of what collides with all; see ``mujoco_arena``.
    answered = sum(2 << other for other in range(count) if other != number)
    marks = {
        NAME: f"robot{number + 1}/",
        TYPE: str(1 | 2 << number),
        ANSWERED: str(answered),
    }
    for motor in range(part["motors"]):
        marks[f"{GROUP}{motor}:"] = str(motors + motor)
    sections = {}
    for name, text in part["sections"].items():
        for mark, value in marks.items():
            text = text.replace(mark, value)
        sections[name] = text
    return sections


def _pieces(robots: Sequence[Part], world: Part) -> list[tuple[str, int, list[float]]]:
    """Numbers of all parts, at their places in the whole."""
    pieces = []
    names = sorted({name for part in (world, *robots) for name in part["fields"]})
    for name in names:
        head = _head(world, name)
        values = world["fields"].get(name)
        if values:
            pieces.append((name, 0, values[:head]))
        place = head
        for part in robots:
            # Each robot's file has a world of its own.
            own = _head(part, name)
            if name in part["fields"]:
                pieces.append((name, place, part["fields"][name][own:]))
            place += part["lengths"].get(name, 0) - own
        if values:
            pieces.append((name, place, values[head:]))
    return [piece for piece in pieces if piece[2]]


def _head(part: Part, name: str) -> int:
    """How many numbers of a field are those of the world's own body."""
    kind, _, _ = name.partition("_")
    rows, of = part["heads"].get(kind, (0, 1))
    return int(part["lengths"].get(name, 0) // of * rows)
