"""An ability: something that robots of a kind can learn, and how."""

from collections.abc import Callable
from dataclasses import dataclass

from bricksrl.envs.task import Task
from bricktwin.robots.as_drawn import DrawnRobot


def _nothing(_drawn: DrawnRobot) -> str:
    return ""


@dataclass(frozen=True)
class Ability:
    """Something to learn.

    Attributes:
        name: in a reference, ``rover.ldr:walk``.
        sentence: what it is, for a list.
        task: makes the task of a robot. Raises DescriptionError, with what the robot lacks, for one
            that cannot learn it.
        agent: what learns it best.
        episodes: of a training run.
        remark: on the robot that learns it, in a clause: what of its drawing makes it hard, or
            other than expected; "" for nothing.
    """

    name: str
    sentence: str
    task: Callable[[DrawnRobot], Task]
    agent: str = "sac"
    episodes: int = 30
    remark: Callable[[DrawnRobot], str] = _nothing
