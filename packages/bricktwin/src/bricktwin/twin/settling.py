"""Settling: robots come to rest where they were put, before an episode begins."""

from collections.abc import Sequence
from typing import Protocol

from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import Quaternion
from bricktwin.twin.model_physics import Placed
from bricktwin.twin.scene import Scene
from bricktwin.twin.stance import refuse_overlap

_SETTLING_STEPS = 400
"""Most steps, a second, in which a robot comes to rest."""
_STEPS_AT_ONCE = 20
_AT_REST = 5e-3
"""Speed of each joint below which a robot is at rest, m/s and rad/s."""
_HELD_KG_M2 = 1e3
"""Inertia of a shaft that a motor holds: nothing on a robot moves it within a second."""


class Settling(Placed, Protocol):
    """A robot that settles.

    Attributes:
        base_address: of the first position of its first joint.
        is_held: whether a hand holds it, so that it does not turn.
    """

    base_address: int
    is_held: bool

    def update_turns(self) -> None:
        """Take note of the present orientation."""

    def hold(self, orientation: Quaternion) -> None:
        """Turn it back to an orientation, at rest."""


def settle(engine: Engine, robots: Sequence[Settling]) -> None:
    """Let robots come to rest where they are put, with their motors held: play is taken up, feet
    find the floor."""
    qpos = engine.qpos
    # Addresses of x and y of each robot that can move: settling must not shift it.
    places: list[int] = []
    armature = engine.parameters("dof_armature")
    held = list(armature)
    for robot in robots:
        if robot.moves:
            places += [robot.base_address, robot.base_address + 1]
        # A person who puts a robot down does not turn its motors.
        for dof in robot.motors.dofs:
            held[dof] = _HELD_KG_M2
    starts_m = [qpos[place] for place in places]

    in_hands: list[tuple[Settling, Quaternion]] = []
    for robot in robots:
        if robot.is_held:
            first = robot.base_address + 3
            w, x, y, z = qpos[first : first + 4]
            in_hands.append((robot, (w, x, y, z)))
    # What a hand holds turns little in the time between two of its looks.
    steps_at_once = 1 if in_hands else _STEPS_AT_ONCE

    engine.set_parameters("dof_armature", held)
    for _ in range(_SETTLING_STEPS // steps_at_once):
        engine.step(steps_at_once)
        for robot, orientation in in_hands:
            robot.hold(orientation)
        if max(map(abs, engine.qvel)) < _AT_REST:
            break
    engine.set_parameters("dof_armature", armature)

    for place, start_m in zip(places, starts_m, strict=True):
        qpos[place] = start_m
    halt(engine)
    # What the solver remembers of before would make an episode depend on the last one.
    engine.forget()
    engine.forward()


def halt(engine: Engine) -> None:
    """Stop all that moves."""
    for dof in range(len(engine.qvel)):
        engine.qvel[dof] = 0.0


def come_to_rest(
    engine: Engine,
    robots: Sequence[Settling],
    scene: Scene | None = None,
) -> None:
    """Let robots that were put somewhere come to rest. Raises TwinError if one is inside of an
    obstacle of the ``scene``, or of an arena."""
    engine.forget()
    engine.forward()
    refuse_overlap(engine, scene)
    settle(engine, robots)
    for robot in robots:
        robot.update_turns()
