"""View of a robot: its pose, hub and link on the board. The thread that steps the robot only copies
the joint positions.

Poses are computed on a separate model (the mirror), by the thread that serves the page, and only if
a browser is connected. So the simulation is bit for bit the same with and without a page.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from brickhub.robot import Robot
from brickhub.virtual.body import Body
from brickhub.virtual.faults import sound_body
from brickhub.virtual.machine import Machine, Pace
from brickhub.virtual.panel import Panel
from bricksrl.errors import BricksError
from bricksrl.page.board import Board
from bricksrl.page.hand import Hand
from bricktwin.twin.make_body import lies_on_bench
from bricktwin.twin.models.mjcf import overview_of
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import Goal, Scene
from bricktwin.twin.sensed_pose import sensed_qpos
from bricktwin.view.drawing_of_body import Floats, View
from bricktwin.view.mirror import Mirror

if TYPE_CHECKING:
    from bricksrl.envs.connection import Connection

SPEEDS = {"1x": 1.0, "10x": 10.0, "max": 0.0}
"""Speeds of simulated time; 0 is as fast as possible."""
VIEW_PERIOD_S = 0.04
"""Period of the view's updates of poses, in wall time."""
NUMBERS_S = 0.2
"""Period of its updates of numbers."""
_MAX_LAG_S = 0.05
"""Lag beyond which the clock is restarted instead of catching up."""
_MIN_LEAD_S = 0.01
"""Least lead for which it waits, as a system's sleep is no shorter."""
_NO_MODEL = "This robot has no model to draw; its numbers are below."
_GOAL_RATIO = 1.3
"""Width over height of the starts and a goal on the floor, as they are seen at once."""


class SteeredPace(Pace):
    """Pace of a machine with a variable speed, and periodic updates of the view; a stop ends a wait
    at once.

    It is called by the thread that steps the robot, once per control loop of simulated time, so it
    must be fast.

    Args:
        machine: machine whose time is paced.
        halted: set when the robot is to stop.
        speed: returns simulated seconds per second, 0 for as fast as possible.
        update_view: called periodically to update the view.
        on_loop: called each time.
        halt: called when halted; by default control returns to the host, which stops the program.
    """

    def __init__(
        self,
        machine: Machine,
        halted: threading.Event,
        speed: Callable[[], float],
        update_view: Callable[[], None],
        on_loop: Callable[[], None],
        halt: Callable[[], None] | None = None,
    ) -> None:
        super().__init__()
        self._halt = halt
        self._machine = machine
        self._halted = halted
        self._speed = speed
        self._update_view = update_view
        self._on_loop = on_loop
        self._view_due_s = 0.0
        self._last_speed = -1.0
        self._start_s = 0.0
        self._start_ms = 0.0

    def keep(self, time_ms: float) -> None:
        """Update the view, and wait if simulated time is ahead."""
        self._on_loop()
        now_s = time.monotonic()
        if now_s >= self._view_due_s:
            self._view_due_s = now_s + VIEW_PERIOD_S
            self._update_view()
        if self._halted.is_set():
            if self._halt is not None:
                self._halt()
            elif self._machine.alarm_ms is not None:
                # Back to the host at once, which then stops the program.
                self._machine.alarm_ms = int(time_ms)
            return
        speed = self._speed()
        if speed <= 0.0:
            return
        due_s = self._start_s + (time_ms - self._start_ms) / 1000 / speed
        ahead_s = due_s - now_s
        # Time that was lost to something slow is not made up for: the robot would rush.
        if speed != self._last_speed or ahead_s < -_MAX_LAG_S:
            self._last_speed = speed
            self._start_s = now_s
            self._start_ms = time_ms
        elif ahead_s > _MIN_LEAD_S:
            self._halted.wait(ahead_s)


class RobotView:
    """View of the present robot on a board.

    Attributes:
        goal: pose that it is to reach, if any; may be set at any time.
        hand: hand that pulls a virtual robot, or an object in its scene.

    Args:
        board: board to write to.
        halted: set while the robot is stopped by an emergency stop.
        speed: speed of a virtual robot, see :class:`SteeredPace`.
    """

    def __init__(
        self,
        board: Board,
        halted: threading.Event,
        speed: Callable[[], float],
    ) -> None:
        self._board = board
        self._halted = halted
        self._speed = speed
        self._mirrors: dict[tuple[str, Scene], Mirror] = {}
        self._current: Mirror | None = None
        self._due_s = self._sensed_s = 0.0
        self.connection: Connection | None = None
        self.goal: Goal | None = None
        self.hand = Hand()
        self._update: Callable[[], None] = lambda: None

    def show(self, connection: Connection) -> None:
        """Show another robot."""
        self.connection = connection
        if connection.twin is not None:
            self.show_machine(connection.twin.machine, body=connection.twin.body)

    def show_machine(
        self,
        machine: Machine,
        halt: Callable[[], None] | None = None,
        body: Body | None = None,
        mirror: Mirror | None = None,
    ) -> None:
        """Show the robot of a machine.

        Args:
            machine: its hub, which keeps the pace.
            halt: as in :class:`SteeredPace`.
            body: the robot's body if the machine has a proxy of it.
            mirror: mirror of a world of several robots.
        """
        body = sound_body(machine.body if body is None else body)
        if isinstance(body, MujocoBody):
            mirror = self._use(mirror or self._mirror(body.robot, body.scene))
        else:
            self._board.update_status(no_scene=_NO_MODEL)

        def update() -> None:
            """Copy the joint positions; called in the thread that steps the robot."""
            # The thread that serves the browser computes the poses from these copies, so that the
            # robot does not wait.
            if mirror is not None and isinstance(body, MujocoBody):
                qpos = body.data.qpos.copy()
                moved_m = body.data.mocap_pos.copy()
                self._board.show_poses(lambda: mirror.poses(qpos, self.goal, moved_m))
            now_s = time.monotonic()
            if now_s >= self._due_s:
                self._due_s = now_s + NUMBERS_S
                self._board.update_status(hub=panel_of(machine.panel))

        def feel() -> None:
            if mirror is not None and isinstance(body, MujocoBody):
                self.hand.act(body, mirror.numbers)

        machine.pace = SteeredPace(
            machine,
            self._halted,
            self._speed,
            update,
            feel,
            halt,
        )
        self._update = update
        update()

    def accompany(self, machine: Machine, halt: Callable[[], None]) -> None:
        """Pace another hub of the world that is shown, whose program may go on for longer than that
        of the hub that is shown. ``halt``: as in :class:`SteeredPace`."""
        machine.pace = SteeredPace(
            machine,
            self._halted,
            self._speed,
            self._update,
            lambda: None,
            halt,
        )

    def show_sensed(
        self,
        robot: Robot,
        scene: Scene,
        angles_deg: dict[str, float],
        tilt_deg: tuple[float, float],
    ) -> None:
        """Show a real robot from its sensors: motor angles by name, pitch and roll."""
        if lies_on_bench(robot, scene):
            self._board.update_status(no_scene=_NO_MODEL)
            return
        now_s = time.monotonic()
        if now_s - self._sensed_s < VIEW_PERIOD_S:
            return
        self._sensed_s = now_s
        try:
            mirror = self._use(self._mirror(robot, scene))
        except BricksError as error:
            # The real robot goes on, and nothing is tried again.
            self._sensed_s = math.inf
            self._board.update_status(no_scene=f"This robot cannot be drawn: {error}.")
            return
        goal = self.goal
        # Where a real robot stands on the floor is unknown, and so is where its goal would be.
        if goal is not None and goal.at_mm is not None:
            goal = None

        def sensed_poses() -> Floats:
            return mirror.poses(sensed_qpos(mirror.body, angles_deg, tilt_deg), goal)

        self._board.show_poses(sensed_poses)

    def show_link(self) -> None:
        """Show the link's state and statistics, and a virtual robot's battery."""
        connection = self.connection
        if connection is None:
            return
        statistics = connection.link.statistics
        p50_ms = statistics.round_trip_p50_s * 1000
        p99_ms = statistics.round_trip_p99_s * 1000
        facts: dict[str, Any] = {
            "link": connection.link.state.value,
            "round trip": f"{p50_ms:.0f} ms (99 %: {p99_ms:.0f} ms)",
            "observation age": f"{statistics.age_p50_s * 1000:.0f} ms",
            "sent again": f"{statistics.resends}",
            "damaged": f"{statistics.crc_errors}",
        }
        if connection.twin is not None:
            facts["battery"] = f"{connection.twin.body.battery_mv / 1000:.2f} V"
        self._board.update_status(link=facts)

    def _mirror(
        self,
        robot: Robot,
        scene: Scene,
    ) -> Mirror:
        """The mirror of a robot, cached."""
        key = (robot.name, scene)
        if key not in self._mirrors:
            view = None
            # A goal on the floor and the starts are to be seen at once.
            if self.goal is not None and self.goal.at_mm is not None:
                target, distance_m = overview_of(scene)
                view = View(target, 0.85 * distance_m, ratio=_GOAL_RATIO)
            self._mirrors[key] = Mirror(
                MujocoBody(
                    robot,
                    scene,
                    Physics(),
                    0,
                ),
                view,
            )
        return self._mirrors[key]

    def _use(self, mirror: Mirror) -> Mirror:
        """Show the scene of a mirror if it is another one."""
        if mirror is not self._current:
            self._current = mirror
            self._board.show_drawing(mirror.drawing, lambda: mirror.poses(mirror.body.data.qpos))
        return mirror


def panel_of(panel: Panel) -> dict[str, Any]:
    """Display and screen (``None`` where the hub has none), text and light of a hub, for the
    page."""
    screen = None
    if panel.screen_pixels is not None:
        width, height = panel.screen_pixels
        screen = {"width": width, "height": height, "pixels": panel.packed_screen()}
    return {
        "screen": screen,
        "display": list(panel.display) if panel.has_display else None,
        "text": panel.text,
        "light": panel.light,
    }
