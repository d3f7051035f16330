"""Arena on the page: each visitor may drive one of its robots; the others follow their policies."""

import threading
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.envs.arenas.arena_env import ArenaEnv
from bricksrl.envs.arenas.arena_task import WHEELS, ArenaTask
from bricksrl.envs.env_interface import interface_of
from bricksrl.page.live import LivePage, PageDriver
from bricksrl.page.play import Steps, play_endlessly
from bricksrl.page.server import PageOptions
from bricksrl.page.visitors import Visitor
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.view.drawing_of_body import View
from bricktwin.view.mirror import Mirror

_FOR_ALL = ("pause", "resume", "step", "reset", "speed")
"""Presses that change the play of all robots; while somebody drives, only who drives may."""
_OPEN_HALF_M = 0.7
"""Half size of the part of an open floor that is seen at first."""
_ARENA_RATIO = 1.45
"""Width over height of an arena as it is seen, with its walls."""


class ArenaPage(LivePage):
    """Page of several robots in one world, served while entered. ``drivers``: the humans who drive
    them, by the robots' names.

    A press names the robot that it is for: ``drive:runner``.
    """

    def __init__(
        self,
        task: ArenaTask,
        subtitle: str = "",
        options: PageOptions | None = None,
    ) -> None:
        robots = zip(task.robots, task.interfaces, strict=True)
        self._arena = task
        self.drivers = {
            # A driver turns the wheels; what the robot tells remains its policy's.
            name: PageDriver([command.entry for command in interface.commands[:WHEELS]])
            for name, interface in robots
        }
        super().__init__(
            task.id,
            subtitle,
            speed="1x",
            options=options,
        )
        self.board.update_status(goal=" ".join(task.doc.strip().partition("\n\n")[0].split()))

    def attach(self, env: Any) -> None:
        """Show another arena."""
        super().attach(env)
        # The first robot's hub keeps the pace of all, as they share one clock.
        self._is_paced_here = False
        half_m = max(self._arena.arena.half_size_m or (_OPEN_HALF_M,))
        # From above, so that no robot hides another one.
        view = View(
            (0.0, 0.0, 0.0),
            2.0 * half_m + 0.8,
            -90.0,
            48.0,
            ratio=_ARENA_RATIO,
        )
        mirror = Mirror(ArenaWorld(self._arena.arena).bodies[0], view)
        machine = env.hub(self._arena.robots[0]).machine
        self.view.show_machine(machine, body=env.world.bodies[0], mirror=mirror)
        self.board.update_status(no_scene="")

    def steered(self, state: TensorDictBase) -> TensorDictBase:
        """A state with actions, those of driven robots replaced by the drivers'."""
        for group, names in self._arena.groups.items():
            actions = state[group, "action"]
            for index, name in enumerate(names):
                if self.drivers[name].in_charge:
                    shares = actions.new_tensor(self.drivers[name].shares())
                    actions[..., index, :WHEELS] = shares
        return state

    @property
    def is_driven(self) -> bool:
        return any(driver.in_charge for driver in self.drivers.values())

    def _handle_seat(
        self,
        name: str,
        value: Any,
        visitor: Visitor,
    ) -> bool:
        action, _, robot = name.partition(":")
        if action == "left":
            driver = self._driver_of(visitor)
            if driver is not None:
                driver.release()
            return True
        # A press may be anything that a browser sends.
        is_answer = isinstance(value, list) and len(value) == 2 and isinstance(value[0], str)
        if action == "answer" and is_answer and value[0] in self.drivers:
            asker = self.seats.answer(value[0], visitor, agrees=value[1] is True)
            if asker is not None:
                self._let_drive(value[0], asker)
            return True
        if robot not in self.drivers:
            if action in _FOR_ALL and self.is_driven and self._driver_of(visitor) is None:
                visitor.note = "Others drive here; take a robot first."
                return True
            return action in ("arrived", "renamed", "ask", "answer")
        if action == "ask":
            if self.seats.ask(robot, visitor):
                self._let_drive(robot, visitor)
        elif not self.seats.may(robot, visitor):
            holder = self.seats.holder(robot)
            if action == "take_over" and holder is not None:
                visitor.note = f"{holder.name} drives the {robot}; ask first."
        elif action == "take_over" and value:
            self._let_drive(robot, visitor)
        elif action == "take_over":
            self.seats.give_back(robot)
            self._let_go(robot)
        elif action == "drive" and self.seats.holder(robot) is visitor:
            self.drivers[robot].push(value)
        return True

    def _let_drive(
        self,
        robot: str,
        visitor: Visitor,
    ) -> None:
        for left in self.seats.take(robot, visitor):
            self._let_go(left)
        self.drivers[robot].release()
        self.drivers[robot].in_charge = True

    def _let_go(self, robot: str) -> None:
        self.drivers[robot].release()
        self.drivers[robot].in_charge = False

    def _driver_of(self, visitor: Visitor) -> PageDriver | None:
        for name, driver in self.drivers.items():
            if self.seats.holder(name) is visitor:
                return driver
        return None

    def _tick(self) -> None:
        freed, again = self.seats.refresh()
        for robot in freed:
            self._let_go(robot)
        for robot in again:
            self.drivers[robot].in_charge = True
        self._publish()

    def _publish(self) -> None:
        super()._publish()
        colors = {robot.name: robot.color for robot in self._arena.arena.robots}
        seats = {}
        for name, driver in self.drivers.items():
            seats[name] = {**driver.described(), "color": colors[name]}
        self.board.update_status(seats=seats)


def play_arena(
    env: ArenaEnv,
    page: ArenaPage,
    policy: TensorDictModuleBase,
    *,
    episodes: int | None = None,
    stop: threading.Event,
) -> list[float]:
    """Play as `play_endlessly`; returns the mean returns of the first group's robots."""
    group = next(iter(env.task.groups))

    def episode(number: str) -> Steps:
        state = env.reset()
        total = 0.0
        steps = 0
        is_over = False
        yield
        while not is_over:
            frame = env.step(page.steered(policy(state)))
            after = frame["next"]
            if bool(after["link_lost"]):
                raise interface_of(env).link_error
            reward = float(after[group, "reward"].mean())
            steps = steps + 1
            total += reward
            page.note(**{"return of": group})
            page.show_outcome([], reward, total)
            yield
            state = env.step_mdp(frame)
            is_over = bool(after["done"])
        outcome = f"succeeds after {steps} steps" if bool(after["success"]) else "does not succeed"
        page.board.update_status(note=f"Episode {number}: {group} {outcome}.")
        return total

    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        return play_endlessly(
            env,
            page,
            episode,
            episodes=episodes,
            stop=stop,
        )
