"""Robot's file in a tab: the robot and scene in it, and their body; and files of robots that share
a world, which are put together here: each robot has a file of its own, and so has each world, as a
file for all that can meet in all worlds would be too many.

Such a file has the sections of an MJCF text, in which what depends on the others is a mark, and
numbers of the compiled model that are more exact than the text. MuJoCo numbers parts by their
bodies, in the order of the text, so that the numbers of the whole are those of its parts, one after
the other: the world itself, the robots, and what can be pushed.
"""

import json
import random
from collections.abc import Sequence
from typing import Any

from brickhub.robot import Robot
from brickhub.seed import derive_seed
from bricktwin.site.tab.js_engine import JsEngine
from bricktwin.site.tab.plain_values import read_plain
from bricktwin.twin.body import NoiseSources, TwinBody
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene

NAME_MARK = "@/"
"""Mark of a robot's name, which begins the names of its parts."""
TYPE_MARK = "@type"
"""Mark of the bits of contact of a robot's geometries, and of those that they answer to."""
ANSWERED_MARK = "@answered"
GROUP_MARK = "@group:"
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


class Draws(random.Random):
    """Generator of random numbers with NumPy's name of the normal ones."""

    def standard_normal(self) -> float:
        """A normally distributed number, of mean 0 and deviation 1."""
        return self.gauss(0.0, 1.0)


def robot_in(file: dict[str, Any]) -> Robot:
    """The robot of a file."""
    robot: Robot = read_plain(file["robot"])
    return robot


def scene_in(file: dict[str, Any]) -> Scene:
    """The scene of a file."""
    scene: Scene = read_plain(file["scene"])
    return scene


def body_in_tab(
    file: dict[str, Any],
    handle: Any,
    physics: Physics | RandomPhysics | None = None,
    seed: int = 0,
) -> TwinBody:
    """Body of a file's robot as of :func:`body_of`, on an ``Engine`` of ``engine.js`` that was made
    of the same file."""
    return body_of(
        file,
        JsEngine(handle),
        physics,
        seed,
    )


def body_of(
    file: dict[str, Any],
    engine: Engine,
    physics: Physics | RandomPhysics | None = None,
    seed: int = 0,
) -> TwinBody:
    """Body of a file's robot in its scene. Raises TwinError if the robot cannot stand at each of
    its starts.

    Args:
        engine: engine of the file's model.
        physics: parameters, or a sampler of them for each reset; ``None`` for the defaults.
        seed: seed of the sensors' noise and of the first start.
    """
    physics = physics or Physics()
    body = TwinBody(
        robot_in(file),
        scene_in(file),
        engine,
        Physics() if isinstance(physics, RandomPhysics) else physics,
        # A seed for each purpose: how often a sensor is read must not move the start.
        NoiseSources(
            readings=Draws(derive_seed(seed, "readings")),
            heading=Draws(derive_seed(seed, "heading")),
        ),
    )
    body.begin(physics, Draws(derive_seed(seed, "start")))
    return body


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
        NAME_MARK: f"robot{number + 1}/",
        TYPE_MARK: str(1 | 2 << number),
        ANSWERED_MARK: str(answered),
    }
    for motor in range(part["motors"]):
        marks[f"{GROUP_MARK}{motor}:"] = str(motors + motor)
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
