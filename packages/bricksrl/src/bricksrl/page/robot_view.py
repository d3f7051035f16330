"""View of a robot: its pose, hub and link on the board. The thread that steps the robot only copies the joint positions.

Poses are computed on a separate model (the mirror), by the thread that serves the page, and only if a browser is connected. So
the simulation is bit for bit the same with and without a page.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brickhub.virtual.panel import Panel
from bricksrl.errors import BricksError
from bricksrl.page.board import Board
from bricksrl.page.clock import VIEW_PERIOD_S, SteeredPace
from bricksrl.page.scene import Floats

if TYPE_CHECKING:
    from brickhub.robot import Robot
    from brickhub.virtual.body import Body
    from brickhub.virtual.machine import Machine
    from bricksrl.envs.connection import Connection
    from bricktwin.twin.mujoco_body import MujocoBody
    from bricktwin.twin.scene import Scene

NUMBERS_S = 0.2
_NO_MODEL = "This robot has no model to draw; its numbers are below."


class Mirror:
    """Model of a robot with a MuJoCo model, for drawing only: its joints are set, not simulated."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        from bricksrl.page.twin_scene import twin_scene
        from bricktwin.twin.mujoco_body import MujocoBody
        from bricktwin.twin.physics import Physics

        self.body = MujocoBody(robot, scene, Physics(), 0)
        self.twin = twin_scene(self.body)

    def poses(self, qpos: NDArray[np.float64]) -> Floats:
        """Poses ``[bodies, 7]`` of the scene's bodies at these joint positions."""
        self.body.data.qpos[:] = qpos
        self.body.update_visuals()
        return self.twin.poses(self.body.data)


class RobotView:
    """View of the present robot on a board.

    Args:
        board: board to write to.
        halted: set while the robot is stopped by an emergency stop.
        speed: speed of a virtual robot, see :class:`SteeredPace`.
    """

    def __init__(self, board: Board, halted: threading.Event, speed: Callable[[], float]) -> None:
        self._board, self._halted, self._speed = board, halted, speed
        self._mirrors: dict[tuple[str, Scene], Mirror] = {}
        self._current: Mirror | None = None
        self._due_s = self._sensed_s = 0.0
        self.connection: Connection | None = None

    @property
    def is_virtual(self) -> bool:
        """True if the present robot is virtual."""
        return self.connection is not None and self.connection.twin is not None

    def show(self, connection: Connection) -> None:
        """Show another robot."""
        self.connection = connection
        if connection.twin is not None:
            self.show_machine(connection.twin.machine, body=connection.twin.body)

    def show_machine(self, machine: Machine, halt: Callable[[], None] | None = None, body: Body | None = None) -> None:
        """Show the robot of a machine; ``body`` is the robot's body if the machine has a proxy of it.

        ``halt`` is as in :class:`SteeredPace`.
        """
        from bricktwin.twin.mujoco_body import MujocoBody

        body = machine.body if body is None else body
        modelled = body if isinstance(body, MujocoBody) else None
        if modelled is None:
            self._board.update_status(no_scene=_NO_MODEL)
        mirror = None if modelled is None else self._mirror(modelled.robot, modelled.scene)
        machine.pace = SteeredPace(machine, self._halted, self._speed, lambda: self._update(machine, mirror, modelled), halt)
        self._update(machine, mirror, modelled)

    def show_sensed(self, robot: Robot, scene: Scene, angles_deg: dict[str, float], tilt_deg: tuple[float, float]) -> None:
        """Show a real robot from its sensors: motor angles by name, pitch and roll."""
        from bricktwin.twin.make_body import lies_on_bench
        from bricktwin.twin.sensed_pose import sensed_qpos

        if lies_on_bench(robot, scene):
            self._board.update_status(no_scene=_NO_MODEL)
            return
        now_s = time.monotonic()
        if now_s - self._sensed_s < VIEW_PERIOD_S:
            return
        self._sensed_s = now_s
        try:
            mirror = self._mirror(robot, scene)
        except BricksError as error:  # the real robot goes on, and nothing is tried again
            self._sensed_s = math.inf
            self._board.update_status(no_scene=f"This robot cannot be drawn: {error}.")
            return
        self._board.show_poses(lambda: mirror.poses(sensed_qpos(mirror.body, angles_deg, tilt_deg)))

    def show_link(self) -> None:
        """Show the link's state and statistics, and a virtual robot's battery."""
        connection = self.connection
        if connection is None:
            return
        link = connection.link
        statistics = link.statistics
        facts: dict[str, Any] = {
            "link": link.state.value,
            "round trip": f"{statistics.round_trip_p50_s * 1000:.0f} ms (99 %: {statistics.round_trip_p99_s * 1000:.0f} ms)",
            "observation age": f"{statistics.age_p50_s * 1000:.0f} ms",
            "sent again": f"{statistics.resends}",
            "damaged": f"{statistics.crc_errors}",
        }
        if connection.twin is not None:
            facts["battery"] = f"{connection.twin.body.battery_mv / 1000:.2f} V"
        self._board.update_status(link=facts)

    def _mirror(self, robot: Robot, scene: Scene) -> Mirror:
        """The mirror of a robot, cached; shows its scene if it is another one."""
        key = (robot.name, scene)
        if key not in self._mirrors:
            self._mirrors[key] = Mirror(robot, scene)
        mirror = self._mirrors[key]
        if mirror is not self._current:
            self._current = mirror
            self._board.show_scene(mirror.twin.scene, lambda: mirror.poses(mirror.body.data.qpos))
        return mirror

    def _update(self, machine: Machine, mirror: Mirror | None, body: MujocoBody | None) -> None:
        """Copy the joint positions; called in the thread that steps the robot."""
        if mirror is not None and body is not None:
            qpos = body.data.qpos.copy()
            self._board.show_poses(lambda: mirror.poses(qpos))
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + NUMBERS_S
            self._board.update_status(hub=panel_of(machine.panel))


def panel_of(panel: Panel) -> dict[str, Any]:
    """Display (``None`` where the hub has none), text and light of a hub, for the page."""
    return {"display": list(panel.display) if panel.has_display else None, "text": panel.text, "light": panel.light}
