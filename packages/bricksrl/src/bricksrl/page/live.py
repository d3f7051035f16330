"""Live page of an environment: shows the robot, and passes the user's presses to it.

Two threads meet here. The one that steps the robot calls `attach`, `show_step`, `hold`, `begin` and
`end`; presses arrive in threads of the server and only set flags for the first one, except an
emergency stop, which goes to the hub at once.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from brickhub.entry import Entry
from bricksrl.envs.env_interface import BricksEnv, interface_of
from bricksrl.errors import BricksError, StoppedError
from bricksrl.page.board import MAX_EPISODES, Board
from bricksrl.page.robot_view import NUMBERS_S, SPEEDS, RobotView
from bricksrl.page.server import PageOptions, PageServer, chosen, is_finite
from bricksrl.page.visitors import Seats, Visitor
from bricksrl.policies.by_name import scores_to_beat
from bricksrl.teleoperation import at_rest, pushed

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor
    from torchrl.envs import EnvBase

    from bricksrl.envs.connection import Connection
    from bricksrl.envs.task import Task

PUSH_TIMEOUT_S = 1.5
"""Time without a message of the page, which repeats the pushes, after which the robot rests, as the
tab may be closed."""
_POLL_S = 0.05
_SEAT = "robot"
"""Name under which the only robot of a page is held."""
_STEP_S = 0.1
"""Step time of a simulation without a robot, at speed 1."""


_TURNS = {"turn": 1.0, "rotation": -1.0}
"""Beginnings of names of commands that turn a robot or an arm, and their sign for a turn to the
right, clockwise from above."""


class PageDriver:
    """Human at the page, as a driver of the rollout, called at each step in the thread that steps
    the robot.

    Args:
        commands: commands of the robot.
        in_charge: drive from the start.
    """

    def __init__(
        self,
        commands: Sequence[Entry],
        *,
        in_charge: bool = False,
    ) -> None:
        self.commands = tuple(commands)
        self.in_charge = in_charge
        self._rest = at_rest(self.commands)
        self._pushes = [0.0] * len(self.commands)
        self._pushed_s = 0.0

    def push(self, values: Any) -> bool:
        """Set the pushes, a number in -1..1 per command; returns False if they are invalid."""
        if not isinstance(values, list) or len(values) != len(self.commands):
            return False
        if not all(map(is_finite, values)):
            return False
        self._pushes = [min(max(float(value), -1.0), 1.0) for value in values]
        self._pushed_s = time.monotonic()
        return True

    def release(self) -> None:
        """Reset all pushes to 0."""
        self._pushes = [0.0] * len(self.commands)

    @property
    def pushes(self) -> list[float]:
        """Present pushes; 0 if the page sent none for :data:`PUSH_TIMEOUT_S`."""
        if time.monotonic() - self._pushed_s > PUSH_TIMEOUT_S:
            self.release()
        return [round(value, 3) for value in self._pushes]

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]``; ``None`` while the policy is in charge."""
        import torch

        return torch.tensor(self.shares()) if self.in_charge else None

    def shares(self) -> list[float]:
        """Action ``[m]`` of the pushes."""
        return pushed(self.pushes, self._rest)

    def actions(self) -> list[float]:
        """Command values of the pushes, in the units of the commands."""
        values = self.shares()
        return [
            (c.high + c.low) / 2 + (c.high - c.low) / 2 * value
            if math.isfinite(c.high - c.low)
            else value
            for c, value in zip(self.commands, values, strict=True)
        ]

    def described(self) -> dict[str, Any]:
        """What the page shows of it."""
        names = [{"name": command.name, "unit": command.unit} for command in self.commands]
        shown = {
            "commands": names,
            "stick": stick_map(self.commands),
            "pushes": self.pushes,
            "actions": self.actions(),
        }
        least = [min(command.low, command.high, key=abs) for command in self.commands]
        moving = [
            f"{command.name} is at least {abs(value):g} {command.unit}"
            for command, value in zip(self.commands, least, strict=True)
            if command.low > 0.0 or command.high < 0.0
        ]
        return {**shown, "in_charge": self.in_charge, "moving": moving}


def stick_map(commands: Sequence[Entry]) -> list[list[float]]:
    """Weights of the joystick's axes (right, forward) for each command: rows of two numbers.

    Commands of a left and a right side are driven like a tank; otherwise a turn, or the first one,
    follows the joystick sideways and the next one forward, and a single one forward.
    """
    sides = [_side(command.name) for command in commands]
    if all(sides):
        # A leg or wheel with a range below zero moves forward with decreasing values.
        ways = [-1.0 if command.high <= 0.0 else 1.0 for command in commands]
        return [[side * way, way] for side, way in zip(sides, ways, strict=True)]
    if len(commands) == 1:
        return [[0.0, 1.0]]
    turns = [
        next((sign for name, sign in _TURNS.items() if command.name.startswith(name)), 0.0)
        for command in commands
    ]
    sideways = next((index for index, sign in enumerate(turns) if sign), 0)
    forward = int(sideways == 0)
    return [
        [(turns[index] or 1.0) * (index == sideways), float(index == forward)]
        for index in range(len(commands))
    ]


def _side(command: str) -> float:
    """Side of what a command moves, by its name: 1 on the left, -1 on the right, else 0."""
    if "left" in command:
        return 1.0
    return -1.0 if "right" in command else 0.0


class LivePage(PageServer):
    """Page of a robot that learns, plays or is driven, served while entered.

    Args:
        title, subtitle: titles of the page.
        task: task of the environment, for its entries and commands.
        in_charge, can_drive: whether a human drives from the start, and may drive at all.
        policies: names of the selectable policies.
        speed: initial speed, one of :data:`SPEEDS`.
        on_stop: called at an emergency stop, before the robot is stopped; must return at once.
        options: address of the server.

    Attributes:
        driver: the human at the page; ``None`` if driving is not possible.
        policy: name of the selected policy.
        is_reset_requested: whether the user has asked for a reset, which ends the episode.
        on_discard: called when the user discards the episode that goes on; ``None`` where nothing
            is recorded.
    """

    def __init__(
        self,
        title: str,
        subtitle: str = "",
        *,
        task: Task | None = None,
        in_charge: bool = False,
        can_drive: bool = True,
        policies: Sequence[str] = (),
        speed: str = "max",
        on_stop: Callable[[], None] = lambda: None,
        options: PageOptions | None = None,
    ) -> None:
        from bricksrl.data.schema import describe_task

        super().__init__(
            Board(),
            self._press,
            self.stop,
            options,
        )
        self._end_run = on_stop
        self.on_discard: Callable[[], None] | None = None
        self._halted = threading.Event()
        self._changed = threading.Event()
        self._paused = False
        self._requested_steps = 0
        self._speed = speed
        self.is_reset_requested = self._is_cutting = False
        self._env = BricksEnv()
        self._is_paced_here = False
        self._unwatch: Callable[[], None] = lambda: None
        self._is_real = self._is_ended = False
        self._policies = tuple(policies)
        self.policy = self._policies[-1] if self._policies else ""
        self._can_give_back = not in_charge or len(self._policies) > 0
        commands = describe_task(task).action if task is not None and can_drive else ()
        self.driver = PageDriver(commands, in_charge=in_charge) if commands else None
        self.seats = Seats()
        self.view = RobotView(self.board, self._halted, lambda: self._speed_factor)
        self._task = task
        self._returns = self.board.new_series(
            "return", ("return of each episode",), max_rows=MAX_EPISODES
        )
        self._rewards = self.board.new_series("reward", ("reward of each step",))
        entries = task.entries if task is not None else ()
        channels = [
            f"{entry.name} ({entry.unit})" if entry.unit else entry.name for entry in entries
        ]
        self._channels = self.board.new_series("channels", channels)
        self._facts: dict[str, Any] = {}
        self._sum = 0.0
        self._steps = 0
        self._count = 0
        self._due_s = 0.0
        self._last_step_s = 0.0
        self._last_rate: tuple[float, int] = (time.monotonic(), 0)
        self.board.update_status(
            title=title,
            subtitle=subtitle,
            speeds=list(SPEEDS),
            policies=list(self._policies),
        )
        if task is not None:
            self.board.update_status(goal=task.summary, scores=scores_to_beat(task.id))
            self._aim_for(())
        self._publish()

    def close(self) -> None:
        """Stop serving."""
        self._unwatch()
        super().close()

    # ------------------------------------------------------------ presses, in threads of the server

    def stop(self) -> None:
        """Emergency stop of the run and the robot, from any thread. Raises BricksError if the robot
        cannot be reached."""
        self._halted.set()
        # an earlier one; only one after the stop lets the robot start again
        self.is_reset_requested = False
        self._end_run()
        try:
            self._env.stop()
        except BricksError as error:  # the hub could not be reached; its watchdog stops it
            self.board.update_status(message=str(error))
            raise
        finally:
            if self.driver is not None:
                self.driver.release()
            self._changed.set()
            self._publish()

    def has_stopped(self) -> bool:
        return self._env.has_stopped

    def _press(
        self,
        name: str,
        value: Any,
        visitor: Visitor | None = None,
    ) -> None:
        if visitor is not None and self._handle_seat(name, value, visitor):
            self._publish()
            return
        match name:
            case "pause" | "resume":
                self._pause(name == "pause")
            case "step" if not self._is_real:
                self._paused = True
                self._requested_steps = self._requested_steps + 1
            case "reset":
                self.is_reset_requested = True
            case "discard" if self.on_discard is not None:
                self.on_discard()
            case "speed":
                self._speed = chosen("speed", value, SPEEDS)
            case "policy" if self._policies:
                self.policy = chosen("policy", value, self._policies)
            case "take_over" if self.driver is not None and self._can_give_back:
                self.driver.in_charge = bool(value)
            case "drive" if self.driver is not None:
                self.driver.push(value)
            case "pull" if not self._is_real:
                self.view.hand.pull(value)
        self._changed.set()
        self._publish()

    def _handle_seat(
        self,
        name: str,
        value: Any,
        visitor: Visitor,
    ) -> bool:
        """Handle what is about who drives; True if the press is done with, or not allowed, as
        somebody else drives."""
        match name:
            case "arrived":
                if self.is_driven and not self._can_give_back and self.seats.holder(_SEAT) is None:
                    self.seats.take(_SEAT, visitor)
            case "left":
                if self.seats.may(_SEAT, visitor):
                    self.view.hand.pull(None)
                    self._release()
            case "ask":
                if self.seats.ask(_SEAT, visitor):
                    self._seat(visitor)
            case "answer":
                agrees = isinstance(value, list) and len(value) == 2 and value[1] is True
                if (asker := self.seats.answer(_SEAT, visitor, agrees=agrees)) is not None:
                    self._release()
                    self._seat(asker)
            case "renamed":
                pass
            case _ if not self.seats.may(_SEAT, visitor):
                holder = self.seats.holder(_SEAT)
                if name not in ("drive", "pull") and holder is not None:
                    visitor.note = f"{holder.name} drives this robot; ask first."
            case "take_over" if self.driver is not None and self._can_give_back:
                if value:
                    self._seat(visitor)
                else:
                    self.seats.give_back(_SEAT)
                    self.driver.in_charge = False
            case _:
                if name == "drive" and self.is_driven:
                    self.seats.take(_SEAT, visitor)
                return False
        return True

    def _seat(self, visitor: Visitor) -> None:
        """Let a visitor drive."""
        if self.driver is not None:
            self.seats.take(_SEAT, visitor)
            self.driver.in_charge = True

    def _release(self) -> None:
        """Let go of the robot, which comes to rest if a human drives."""
        if self.driver is not None:
            self.driver.release()

    def _tick(self) -> None:
        """Free what is held by somebody who is away; give it back to who has returned."""
        freed, again = self.seats.refresh()
        if self.driver is not None:
            if freed:
                self._release()
                self.driver.in_charge = not self._can_give_back
            if again:
                self.driver.in_charge = True
        self._publish()

    def _pause(self, paused: bool) -> None:
        self._paused = paused
        self._requested_steps = 0
        if self._halted.is_set():
            return
        if paused and self._is_real:
            self._env.pause()
        elif not paused and self._env.is_paused:
            self._env.resume()

    # ----------------------------------------------------------- in the thread that steps the robot

    @property
    def is_stopped(self) -> bool:
        """True after an emergency stop, until `release`."""
        return self._halted.is_set()

    @property
    def is_driven(self) -> bool:
        """Whether a human drives."""
        return self.driver is not None and self.driver.in_charge

    def attach(self, env: EnvBase) -> None:
        """Show another environment."""
        self._unwatch()
        self._env = interface_of(env)
        self._unwatch = lambda: None
        self._is_paced_here = not env.batch_size and self._env.robots != 1
        if env.batch_size:  # robots of other processes, or none
            self.board.update_status(
                no_scene=f"{env.batch_size.numel()} copies learn at once; their returns are below."
            )
        elif self._env.robots == 1:
            self.board.update_status(no_scene="")
            self._unwatch = self._env.watch(self._show_connection)
        elif self._env.robots:
            self.board.update_status(
                no_scene="Several robots learn at once; their returns are below."
            )
        else:
            self.board.update_status(
                no_scene="This is a simulation without a robot; its numbers are below."
            )
        self._publish()

    def _show_connection(self, connection: Connection) -> None:
        self.view.show(connection)
        twin = connection.twin
        self._is_real = twin is None or twin.is_realtime
        self._publish()

    def begin(self) -> None:
        """Begin an episode."""
        self._sum = 0.0
        self._steps = 0
        self.clear_reset()
        self._publish()

    def _aim_for(self, observation: Sequence[float]) -> None:
        """Show the goal of an observation."""
        self.view.goal = None if self._task is None else self._task.goal(observation)
        self.board.update_status(has_ghost=self.view.goal is not None)

    def show_step(self, frame: TensorDictBase) -> None:
        """Show a step, as returned by TorchRL's ``EnvBase.step``."""
        after = frame["next"]
        reward = float(after["reward"])
        image = {"image": after["image"].numpy()} if "image" in after else {}
        self.show_outcome(
            after["observation"].tolist(),
            reward,
            self._sum + reward,
            **image,
        )

    def show_outcome(
        self,
        values: list[float],
        reward: float | None,
        total: float,
        image: Any = None,
    ) -> None:
        """Show the observation ``[n]`` after a step, its reward, if it is known, the return so far,
        and the camera's image."""
        self._sum = total
        self._steps = self._steps + 1
        self._count = self._count + 1
        if reward is not None:
            self._rewards.add((reward,))
        self._channels.add(values)
        if self._steps == 1:
            self._aim_for(values)
        now_s = time.monotonic()
        if (
            self._task is not None
            and self.view.connection is not None
            and self.view.connection.twin is None
        ):
            sensed = {
                entry.name: value for entry, value in zip(self._task.entries, values, strict=False)
            }
            angles = {
                name.removesuffix("_angle"): value
                for name, value in sensed.items()
                if name.endswith("_angle")
            }
            tilt = (sensed.get("pitch", 0.0), sensed.get("roll", 0.0))
            self.view.show_sensed(
                self._task.robot,
                self._task.scene,
                angles,
                tilt,
            )
        if now_s < self._due_s:
            return
        self._due_s = now_s + NUMBERS_S
        if image is not None:
            self.board.show_image(image.astype(np.uint8, copy=True))
        last_s, last_count = self._last_rate
        self._last_rate = (now_s, self._count)
        self._facts |= {"step": self._steps} | (
            {} if reward is None else {"return": total, "reward": reward}
        )
        self._facts["steps/s"] = (self._count - last_count) / max(now_s - last_s, 1e-3)
        metrics = self._env.walk_metrics()
        if "forward_m" in metrics:
            self._facts["distance"] = f"{metrics['forward_m']:.2f} m"
        self.view.show_link()
        self._publish()

    def show_step_and_hold(self, frame: TensorDictBase) -> None:
        """Call `show_step`, `hold` and `cut`. Raises StoppedError after an emergency stop, also of
        a simulation."""
        self.show_step(frame)
        self.hold()
        if self.is_stopped:
            raise StoppedError("the robot was stopped by hand")
        self.cut()

    def note(self, **facts: Any) -> None:
        """Facts to show with the next numbers, by name."""
        self._facts |= facts

    def end(
        self,
        return_: float,
        episode: str,
    ) -> None:
        """End an episode; ``episode`` is the text shown as its number, or the next one's."""
        self._returns.add((return_,))
        self._facts |= {"episode": episode, "return": return_}
        self._publish()

    def hold(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """Wait before the next step while paused; a simulation without a robot is paced here
        too."""
        while (
            self._paused
            and not self._is_real
            and not self.is_reset_requested
            and not self._halted.is_set()
        ):
            if self._requested_steps:
                self._requested_steps -= 1
                break
            if is_over():
                return
            self._await_press()
        speed = self._speed_factor
        if self._is_paced_here and speed:
            now_s = time.perf_counter()
            self._last_step_s = max(self._last_step_s + _STEP_S / speed, now_s - _STEP_S)
            self._halted.wait(max(0.0, self._last_step_s - now_s))

    def cut(self) -> None:
        """If a reset is requested, end the episode by a pause: it truncates the next step, so that
        no transition spans the reset."""
        if self.is_reset_requested and not self._is_cutting and self._env.robots:
            self._env.pause()
            self._is_cutting = True

    def clear_reset(self) -> None:
        """Clear a requested reset and its pause at the end of an episode."""
        if self._is_cutting and not self.is_stopped:
            self._env.resume()
        self.is_reset_requested = self._is_cutting = False

    def mark_stopped(self) -> None:
        """Record that the robot was stopped."""
        self._halted.set()
        self._publish()

    def wait_for_reset(self, is_over: Callable[[], bool]) -> None:
        """After a stop or a failure: wait for a reset, or until ``is_over()``."""
        while not self.is_reset_requested and not is_over():
            self._await_press()

    def _await_press(self) -> None:
        self._changed.wait(_POLL_S)
        self._changed.clear()

    def release(self) -> None:
        """End an emergency stop: the robot may move again after the next reset."""
        self._halted.clear()
        self.board.update_status(stop=None)
        self._env.resume()
        self._paused = False
        self._publish()

    @property
    def _speed_factor(self) -> float:
        """Speed of simulated time: 1 while a human drives, 0 (not paced here) for a robot in real
        time."""
        if self._is_real:
            return 0.0
        return 1.0 if self.is_driven else SPEEDS[self._speed]

    @property
    def _state(self) -> str:
        """What a run does that has not ended."""
        if self._halted.is_set():
            return "stopped"
        return "paused" if self._paused or self._env.is_paused else "running"

    def _publish(self) -> None:
        driver = self.driver
        self.board.update_status(**self.seats.described())
        controls = ["stop", "pause", "reset"]
        if self.on_discard is not None:
            controls.append("discard")
        # A real robot's time is its own, and nobody pulls it but by hand.
        if not self._is_real:
            controls += ["step", "speed", "pull"]
        if driver is not None:
            controls.append("drive")
        if len(self._policies) > 1:
            controls.append("policy")
        if not self._is_ended:
            self.board.update_status(state=self._state)
        speed = "1x" if self._speed_factor == 1.0 else self._speed
        self.board.update_status(
            controls=controls,
            speed=speed,
            policy=self.policy,
            facts=dict(self._facts),
        )
        if driver is not None:
            self.board.update_status(
                drive={**driver.described(), "can_give_back": self._can_give_back}
            )

    def finish(self, message: str = "") -> None:
        """Show that the run is over; the message is good news."""
        self._is_ended = True
        self.board.update_status(
            state="finished",
            message="",
            note=message,
        )
