"""World of an arena in MuJoCo's Python build, which its robots' models are put together for."""

import functools

import mujoco
import numpy as np

from brickhub.errors import TwinError
from bricktwin.twin.arena import Arena, Contestant, Load, Mark, SharedWorld, SharingBody
from bricktwin.twin.body import NoiseSources
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.models.kept_models import kept_model, model_stamps
from bricktwin.twin.models.mjcf import LOOKS, add_camera, add_light, new_spec
from bricktwin.twin.models.scenery import add_geom, add_objects
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

_WALL_HALF_HEIGHT_M = 0.04
_WALL_HALF_WIDTH_M = 0.012
_WALL_RGB = (0.55, 0.58, 0.62)
_LOAD_RGB = (0.85, 0.55, 0.15)


@functools.lru_cache(maxsize=4)
def _compiled(
    arena: Arena,
    _stamps: tuple[tuple[tuple[str, int, int], ...], ...],
) -> mujoco.MjModel:
    """Compiled model of an arena; copy it before use. The stamps are of its robots' files, as
    somebody may go on drawing meanwhile."""
    robots = [contestant.robot for contestant in arena.robots]
    return kept_model(lambda: arena_spec(arena), robots, arena)


def arena_model(arena: Arena) -> mujoco.MjModel:
    """Compiled model of an arena; copy it before use. Raises TwinError if a robot cannot move."""
    return _compiled(arena, tuple(model_stamps(contestant.robot) for contestant in arena.robots))


def world_spec(scene: Scene) -> mujoco.MjSpec:
    """Model of what is around the robots of an arena: what lies on the floor of a scene."""
    spec = new_spec("arena", OPEN_FLOOR)
    add_objects(spec, scene)
    return spec


def arena_spec(arena: Arena) -> mujoco.MjSpec:
    """Model of an arena: the models of its robots, attached to one world."""
    spec = new_spec("arena", OPEN_FLOOR)
    world = spec.worldbody
    add_light(world)
    half_sizes_m = arena.half_size_m or (0.7,)
    add_camera(
        world,
        "arena",
        target=(0.0, 0.0, 0.0),
        direction=(0.0, -0.75, 1.0),
        distance_m=2.6 * max(half_sizes_m) + 0.4,
    )
    if arena.half_size_m is not None:
        _add_walls(world, *arena.half_size_m)
    for number, contestant in enumerate(arena.robots):
        _add_robot(
            spec,
            contestant,
            number,
            len(arena.robots),
        )
    # Each model numbers its motors from 0; a group of its own opens one circuit alone.
    for group, actuator in enumerate(spec.actuators):
        actuator.group = group
    for load in arena.loads:
        _add_load(world, load)
    for mark in arena.marks:
        _add_mark(world, mark)
    add_objects(spec, arena.scene)
    return spec


def _add_robot(
    spec: mujoco.MjSpec,
    contestant: Contestant,
    number: int,
    count: int,
) -> None:
    """Add a robot, one of ``count``. Raises TwinError if it cannot move."""
    # Takes longer to import than a kept model to load.
    from bricktwin.twin.models.load import load_model

    child = load_model(contestant.robot, OPEN_FLOOR, alone=False)
    chassis = child.body("chassis")
    joints: list[mujoco.MjsJoint] = [] if chassis is None else chassis.joints
    if not joints or joints[0].type != mujoco.mjtJoint.mjJNT_FREE:
        raise TwinError(
            f"robot '{contestant.robot.name}' stands on a fixed base; only robots that move about "
            "share a world"
        )
    # Robots collide with one another and with their surroundings: bit 0 is that of what collides
    # with all, and each robot has a bit to which the others answer.
    others = sum(2 << other for other in range(count) if other != number)
    for geom in child.geoms:
        if geom.contype:
            geom.contype = 1 | 2 << number
            geom.conaffinity = others
    # What there is one of for all: the light, and how matrices are stored.
    for light in list(child.lights):
        child.delete(light)
    child.option.jacobian = spec.option.jacobian
    spec.worldbody.add_frame().attach_body(chassis, f"{contestant.name}/", "")
    # A disc on the hub, by whose colour a person knows the robot.
    spec.body(f"{contestant.name}/chassis").add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=[-0.016, 0.0, 0.062],
        size=[0.022, 0.004, 0.0],
        rgba=[*contestant.color, 1.0],
        mass=0.0,
        **LOOKS,
    )


def _add_walls(
    world: mujoco.MjsBody,
    half_x_m: float,
    half_y_m: float,
) -> None:
    """Add four walls around the floor."""
    for axis, half_m in enumerate((half_x_m, half_y_m)):
        for side, sign in ((1, "+"), (-1, "-")):
            position = [0.0, 0.0, _WALL_HALF_HEIGHT_M]
            position[axis] = side * (half_m + _WALL_HALF_WIDTH_M)
            size = [half_x_m, half_y_m, _WALL_HALF_HEIGHT_M]
            size[axis] = _WALL_HALF_WIDTH_M
            add_geom(
                world,
                f"wall_{axis}{sign}",
                position,
                size,
                _WALL_RGB,
            )


def _add_load(world: mujoco.MjsBody, load: Load) -> None:
    """Add a box that robots can push; where it lies is drawn at each start."""
    half_height_m = load.half_size_m[2]
    body = world.add_body(name=load.name, pos=[0.0, 0.0, half_height_m])
    body.add_freejoint(name=load.name)
    half = list(load.half_size_m)
    # Above the priority of tyres: their friction is not that of a box on the floor.
    add_geom(
        body,
        load.name,
        [0.0] * 3,
        half,
        _LOAD_RGB,
        mass_kg=load.mass_kg,
        friction=load.friction,
        priority=2,
    )


def _add_mark(world: mujoco.MjsBody, mark: Mark) -> None:
    """Add a box that nothing touches, and that stays where it is put."""
    body = world.add_body(name=mark.name, mocap=True)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[0.0, 0.0, mark.half_size_m[2]],
        size=list(mark.half_size_m),
        rgba=[*mark.color, 1.0],
        **LOOKS,
    )


class ArenaBody(SharingBody, MujocoBody):
    """Part of an arena's world that belongs to one robot."""


class ArenaWorld(SharedWorld[ArenaBody]):
    """World of an arena in MuJoCo.

    Args:
        physics: physics of all robots.
        seed: seed of the sensors' noise.
    """

    engine: MujocoEngine

    def __init__(
        self,
        arena: Arena,
        physics: Physics | None = None,
        seed: int = 0,
    ) -> None:
        noises = []
        for noise_seed in np.random.SeedSequence(seed).spawn(len(arena.robots)):
            (heading_seed,) = noise_seed.spawn(1)
            noises.append(
                NoiseSources(np.random.default_rng(noise_seed), np.random.default_rng(heading_seed))
            )
        super().__init__(
            arena,
            MujocoEngine(arena_model(arena)),
            ArenaBody,
            physics or Physics(),
            noises,
        )
