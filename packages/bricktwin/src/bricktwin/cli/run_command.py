"""``bricktwin run``: programs on a hub whose robot has a body, and films of it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import UseAppendAction

from brickhub.cli import run_command as run
from brickhub.cli.terminal import print_note
from brickhub.errors import DescriptionError
from brickhub.options import Existing, option
from brickhub.user_files import check_there

if TYPE_CHECKING:
    from brickhub.target import Target
    from brickhub.virtual.body import Body
    from brickhub.virtual.room import Room
    from bricktwin.twin.mujoco_arena import ArenaWorld

ROBOT_OF_SCENES = "scout"
"""Robot of films and scenes where none is named: it has an eye for walls and one for lines."""


@dataclass(frozen=True)
class Run(run.Run):
    """Run a Pybricks program on a hub, virtual or real, and print its output and traceback; exit
    code 1 if it raises.

    Files that it imports from its folder are included. The program can read standard input. Ctrl-C
    stops it and its motors. A program that imports LEGO's package `legoeducation` runs on this
    computer, and drives virtual devices of LEGO's kits.

    Without --robot, the virtual hub adapts to the program: its kind is the one that the program
    imports, and each port has the device that the program expects there. With --video or --scene,
    the robot is the scout by default, a 2Wheeler with a color sensor.

    Examples:
      bricktwin run main.py --robot walker --video walk.mp4
      bricktwin run main.py --robot my_robot.ldr --video drive.mp4
      bricktwin run main.py --robot my_robot.py --time-limit-s 60
      bricktwin run main.py --robot my_robot.ldr --scene mat.py
      bricktwin run follow.py --scene line-simple --video follow.mp4
      bricktwin run follow.py --scene mat.png:fll
      bricktwin run main.py --reading B=red --reading C=200mm --press left@2.5s
      bricktwin run main.py --hub ble
      bricktwin run left.py right.py --robot two-wheeler --robot scout
      bricktwin run left.py right.py --robot scout --robot scout --scene sumo
      bricktwin run lego_program.py --robot cart --video cart.mp4
    """

    robot: Annotated[
        UseAppendAction[tuple[str, ...]], option(metavar="ROBOT"), Existing(check_there)
    ] = ()
    """Virtual robot: two-wheeler, scout, ev3-driver, walker, robo-arm, cart or bench; a building
    plan, my_robot.ldr; my_robot.py. With several programs once for each, in their order: they share
    one world."""
    scene: Annotated[str | None, option(metavar="SCENE"), Existing(check_there)] = None
    """Scene of the virtual robot: a world of ours, line-simple, line-sharp, line-junctions,
    line-gaps, line-obstacles, colors, squares, maze, cans, ramps, wall, room, sumo, football,
    blocks or table (`bricktwin world list`); a picture as the floor, mat.png:1000x700 in mm, or
    mat.png:fll; that of a Python file, my_scene.py, or my_scene.py:MAT. By default the only one in
    the robot's own file."""
    video: Annotated[Path | None, option(metavar="FILE")] = None
    """Film the virtual robot into this mp4 file."""

    of_a_room: ClassVar[tuple[str, ...]] = (*run.Run.of_a_room, "--scene")

    def target(self, name: str) -> Target:
        """The robot of that name. Notes about its own scenes are left out where a scene is
        given."""
        from brickhub.target import find

        return super().target(name) if self.scene is None else find(name)

    def body(self, stack: ExitStack) -> Body | None:
        body = self._made_body(stack)
        free = motors_without_stops(body, self.file)
        if free:
            stops = " ".join(f"--end-stop {port}=-90..90" for port in free)
            print_note(
                "run_until_stalled waits for something that stops the motor; in this twin "
                f"nothing does: give {stops}"
            )
        return body

    def bodies(self, stack: ExitStack) -> Sequence[Body | None]:
        if not self.robot:
            if self.scene is not None:
                raise DescriptionError(
                    "a scene of several hubs needs their robots; name one for each program, "
                    "--robot scout --robot scout"
                )
            return super().bodies(stack)
        return self.world.bodies

    def distance_m(self, one: int, other: int) -> float:
        if not self.robot:
            return super().distance_m(one, other)
        return self.world.distance_m(one, other)

    def settle_in(self, room: Room) -> None:
        if self.robot:
            world = self.world
            world.runners = [partial(room.run_until, number) for number in range(len(world.bodies))]

    @cached_property
    def world(self) -> ArenaWorld:
        """The world that several robots share: they stand side by side, and look ahead."""
        from bricktwin.target import load_scene, shared_world
        from bricktwin.twin.scene import OPEN_FLOOR

        scene = OPEN_FLOOR if self.scene is None else load_scene(self.scene)
        return shared_world([(name, self.target(name)) for name in self.robot], scene)

    def _made_body(self, stack: ExitStack) -> Body | None:
        if self.video is None and self.scene is None:
            return super().body(stack)
        # This is imported late, because a program without a body or a scene needs no physics.
        from bricktwin.target import body_of, load_scene

        scene = None if self.scene is None else load_scene(self.scene)
        target = self.target(self.robot[0] if self.robot else ROBOT_OF_SCENES)
        body = body_of(target, scene, **self.stops_of(target))
        if self.video is None:
            return self.faulty(body)
        from bricktwin.twin.render.video import filmed

        return self.faulty(stack.enter_context(filmed(body, self.video)))


def motors_without_stops(body: Body | None, program: Path) -> list[str]:
    """Ports of motors that nothing stops in a twin, if a program waits for a motor to stall. Motors
    of the drive base are left out, and so are ports that the program does not name."""
    if body is None:
        return []
    text = program.read_text(encoding="utf-8", errors="replace")
    if "run_until_stalled" not in text:
        return []
    # A program that names no port may compute it, so it may use any port.
    named = set(re.findall(r"\bPort\.([A-F])\b", text))
    base = body.robot.drive_base
    wheels = () if base is None else (base.left, base.right)
    # A bench has no method for this: its only stops are those of the description.
    is_stopped = getattr(body, "is_stopped", lambda port: False)
    ports = []
    for motor in body.robot.motors:
        if motor.name in wheels or motor.end_stops_deg is not None:
            continue
        is_named = motor.port in named or not named
        if is_named and not is_stopped(motor.port):
            ports.append(motor.port)
    return ports
