"""Targets with a body: our robots, robots in the user's files, and building plans."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brickhub.errors import DescriptionError, TwinError, UnknownNameError, hint
from brickhub.robot import BENCH, Robot
from brickhub.target import Target, find_in_files, whole_interface
from brickhub.user_files import (
    is_reference,
    load_object,
    objects_in,
    with_absolute_file,
    without_name,
)
from brickhub.virtual.body import Body
from bricktwin import robots
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.robots.planned import completed, is_plan
from bricktwin.twin.floor_picture import read_picture
from bricktwin.twin.make_body import lies_on_bench, make_body
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.worlds import WORLDS, world
from bricktwin.worlds.games import TABLE_MM, table

if TYPE_CHECKING:
    from bricktwin.twin.mujoco_arena import ArenaWorld

_PICTURES = (".png", ".jpg", ".jpeg", ".gif", ".bmp", ".webp")
_TABLE = "fll"
"""Size of a picture that stands for the table of FIRST LEGO League."""


def find(name: str) -> Target:
    """One of our robots, the robot of a building plan, or the robot in a user's file. Raises
    UnknownNameError if there is none, DescriptionError or PlanError if a file is wrong."""
    if name in robots.ROBOTS:
        return with_body(robots.get(name))
    if is_plan(name):
        return with_body(robot_as_drawn(name).robot)
    if not is_reference(name):
        raise UnknownNameError(
            f"there is no robot '{name}'; choose {', '.join(robots.ROBOTS)}, or name a file: "
            "my_robot.ldr or my_robot.py"
        )
    return _in_scene(find_in_files(name, completed), name)


def _in_scene(target: Target, reference: str) -> Target:
    """The robot of a user's file in the only scene of that file, or on an open floor."""
    scenes = objects_in(reference, Scene)
    file = without_name(reference)
    named = [name for name in scenes if name.isidentifier()]
    # A robot with a name of its own goes before one that is only in a list or a dictionary.
    candidates = named or list(scenes)
    if len(candidates) == 1:
        taken = candidates[0]
        scene = scenes[taken]
        make_in_scene = partial(make_body, target.robot, scene=scene)
        others = ", ".join(name for name in scenes if name != taken)
        note = f"{file} has the scene {taken}, which is taken, and {others}, not taken"
        return replace(
            target,
            make_body=make_in_scene,
            scene=scene,
            note=note if others else "",
            share_world=shared_world,
        )
    # Several robots are offered and none is the default, so the message tells how to name one.
    note = ""
    if scenes:
        first = candidates[0]
        remedy = f"name one: --scene {file}:{first}"
        if not named:
            remedy = f"give one a name, MAT = {first}, and name it: --scene {file}:MAT"
        note = f"{file} has scenes {', '.join(scenes)}, and none is taken; {remedy}"
    return replace(
        target,
        make_body=partial(make_body, target.robot),
        note=note,
        share_world=shared_world,
    )


def load_scene(reference: str) -> Scene:
    """The scene that a user names: one of our worlds; a picture with its size, ``mat.png:fll``;
    ``my_robot.py:ARENA``, or a file with a single one.

    Raises UnknownNameError if there is none, DescriptionError if the file is wrong, or what is
    named is no scene, TwinError if the picture cannot be the floor.
    """
    if reference in WORLDS:
        return world(reference)
    if is_picture(reference):
        return _scene_of_picture(reference)
    if not is_reference(reference):
        raise UnknownNameError(
            f"'{reference}' is not a scene{hint(reference, WORLDS)}; choose {', '.join(WORLDS)}, "
            "or name a Python file with one, such as my_scene.py or my_scene.py:MAT, or a picture, "
            "mat.png:fll or mat.png:1000x700"
        )
    scene = load_object(reference, Scene)
    if not isinstance(scene, Scene):
        raise DescriptionError(f"{reference} is not a scene; name a Scene that is written there")
    return scene


def scene_name(reference: str) -> str:
    """Short name of a scene that a user names: ``mat`` of ``pictures/mat.png:fll``."""
    file, _, named = reference.rpartition(":")
    if is_picture(reference) or not file:
        return Path(file or reference).stem
    return named


def absolute_scene(reference: str) -> str:
    """A scene that a user names, with the absolute path of its file, for use in any folder."""
    if not is_picture(reference):
        return with_absolute_file(reference)
    file, _, size = reference.rpartition(":")
    return f"{os.path.abspath(file)}:{size}" if file else reference  # noqa: PTH100


class ScenesWithoutCode(Container[object]):
    """Names of scenes that execute no code of a user's: our worlds, and pictures."""

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name in WORLDS or is_picture(name))


def is_picture(reference: str) -> bool:
    """Whether this names an image file, with or without its size."""
    file, _, _ = reference.rpartition(":")
    return any(name.lower().endswith(_PICTURES) for name in (reference, file))


def picture_and_size(reference: str) -> tuple[Path, tuple[float, float]]:
    """Image file and size (mm) of ``mat.png:2362x1143`` or ``mat.png:fll``. Raises
    DescriptionError without a size."""
    file, _, size = reference.rpartition(":")
    sides = re.fullmatch(r"(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)", size)
    if size == _TABLE:
        return Path(file), TABLE_MM
    if sides is None:
        path = reference if reference.lower().endswith(_PICTURES) else file
        raise DescriptionError(
            f"how large is {path} on the floor? Give width and height in mm, {path}:1000x700, or "
            f"{path}:{_TABLE} for the table of FIRST LEGO League"
        )
    return Path(file), (float(sides[1]), float(sides[2]))


def _scene_of_picture(reference: str) -> Scene:
    path, size_mm = picture_and_size(reference)
    picture = read_picture(path, size_mm)
    if reference.endswith(f":{_TABLE}"):
        return table(picture)
    return Scene(objects=(picture,))


def body_of(
    target: Target,
    scene: Scene | None,
    **options: Any,
) -> Body:
    """The body of a target in its own scene, or in another one; further options are those of
    `make_body`. Raises TwinError if a robot on the bench is to be in a scene."""
    if scene is None:
        return target.make_body(**options)
    if lies_on_bench(target.robot, scene) and not (scene.readings or scene.end_stops):
        raise TwinError(
            f"'{target.name}' lies on the bench, which is in no scene; leave out --scene, or take "
            "a robot with a body"
        )
    return target.make_body(scene=scene, **options)


def with_body(robot: Robot) -> Target:
    """A robot on an open floor, or on the bench if it has no body."""
    return Target(
        robot.name,
        robot,
        whole_interface(robot),
        partial(make_body, robot),
        share_world=shared_world,
    )


def shared_world(
    named: Sequence[tuple[str, Target]],
    scene: Scene = OPEN_FLOOR,
) -> ArenaWorld:
    """The world that robots share: they stand side by side, and look ahead.

    Args:
        named: targets, each with the name that a person gave.
        scene: what is around them.

    Raises:
        DescriptionError: one is a bench, or has surroundings of its own.
        TwinError: a robot has no model, they have too many motors, or the scene is for one robot
            alone or has no room for them.
    """
    # A program without a world needs no physics.
    import numpy as np

    from bricktwin.twin.arena import side_by_side
    from bricktwin.twin.mujoco_arena import ArenaWorld

    for name, target in named:
        if target.robot is BENCH:
            raise DescriptionError(
                "a bench has no body to share a world with robots; name robots alone, or no robot"
            )
        if target.scene not in (None, OPEN_FLOOR):
            raise DescriptionError(_has_surroundings(name, target.robot))
    world = ArenaWorld(side_by_side([target.robot for _, target in named], scene))
    world.place(np.random.default_rng(0))
    return world


def _has_surroundings(name: str, robot: Robot) -> str:
    """The message for a robot whose surroundings several robots would not share."""
    # An environment's robot has a name of its own; a file's scene can only go elsewhere.
    remedy = "take the scene out of the file"
    if robot in robots.ROBOTS.values():
        remedy = f"name its robot alone: {robot.name}"
    return (
        f"{name} has surroundings, and robots that share a world have one scene for all; {remedy}"
    )
