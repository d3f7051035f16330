"""Tasks of building plans: ``rover.ldr:walk`` is the task of a drawn robot that learns to walk."""

from dataclasses import dataclass

from brickhub.files import quoted
from brickhub.user_files import without_name
from bricksrl.envs.abilities.ability import Ability
from bricksrl.envs.abilities.balancing import keep_upright
from bricksrl.envs.abilities.driving import (
    drive_away,
    follow_line,
    park,
    remark_on_line,
    spin,
    stop_before_wall,
)
from bricksrl.envs.abilities.reaching import reach
from bricksrl.envs.abilities.walking import drive_ahead, walk
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError, UnknownNameError, hint
from bricktwin.robots.as_drawn import DrawnRobot, robot_as_drawn
from bricktwin.twin.make_body import make_body

ABILITIES = {
    ability.name: ability
    for ability in (
        Ability(
            "walk",
            "walk forward",
            walk,
            agent="gait",
            episodes=3,
        ),
        Ability(
            "upright",
            "keep upright on two wheels",
            keep_upright,
            agent="gait",
            episodes=30,
        ),
        Ability(
            "stop",
            "stop before a wall",
            stop_before_wall,
            agent="gait",
            episodes=40,
        ),
        Ability(
            "away",
            "drive away from a wall",
            drive_away,
            episodes=20,
        ),
        Ability(
            "spin",
            "spin to the side that it is told",
            spin,
            episodes=15,
        ),
        Ability(
            "line",
            "follow the edge of a line",
            follow_line,
            agent="gait",
            episodes=30,
            remark=remark_on_line,
        ),
        Ability(
            "park",
            "park in a bay",
            park,
            episodes=60,
        ),
        Ability(
            "ahead",
            "drive ahead",
            drive_ahead,
            agent="gait",
            episodes=2,
        ),
        Ability(
            "reach",
            "turn its joints to a goal",
            reach,
            episodes=100,
        ),
    )
}
"""What drawn robots may learn, by name; the first ones need the least time, and each robot is
offered the first that it can at first."""


@dataclass(frozen=True)
class Offer:
    """An ability for a robot.

    Attributes:
        task: how it learns that; ``None`` if it cannot.
        reason: why not; "" if it can.
        remark: what to know before it does, in a clause; "" for nothing.
    """

    ability: Ability
    task: Task | None
    reason: str = ""
    remark: str = ""


def offers(drawn: DrawnRobot) -> list[Offer]:
    """All abilities, with the task of this robot or the reason why it has none. Raises TwinError if
    the robot has no body, as where a motor is loose."""
    # Whoever has no body learns nothing, whatever its motors turn.
    make_body(drawn.robot)
    found: list[Offer] = []
    for ability in ABILITIES.values():
        try:
            task = ability.task(drawn)
            found.append(Offer(ability, task, remark=ability.remark(drawn)))
        except DescriptionError as error:
            found.append(Offer(ability, None, str(error)))
    return found


def ability_of(reference: str) -> Ability:
    """The ability that a reference names. Raises UnknownNameError if there is none."""
    file = without_name(reference)
    name = reference[len(file) + 1 :]
    if name in ABILITIES:
        return ABILITIES[name]
    known = ", ".join(ABILITIES)
    if not name:
        raise UnknownNameError(
            f"{file} is a plan; name what its robot is to learn, such as {file}:walk ({known}): "
            f"`bricksrl learn {quoted(file)} --look` says what it can"
        )
    raise UnknownNameError(
        f"nothing that a robot learns is called '{name}'{hint(name, ABILITIES)}; choose {known}"
    )


def task_of_plan(reference: str) -> Task:
    """The task that a reference to a plan names. Raises UnknownNameError if it names nothing that
    robots learn, DescriptionError if this one cannot, PlanError if the plan cannot be read."""
    ability = ability_of(reference)
    file = without_name(reference)
    drawn = robot_as_drawn(file)
    try:
        return ability.task(drawn)
    except DescriptionError as error:
        raise DescriptionError(
            f"{drawn.robot.name} cannot learn to {ability.sentence}: {error}; "
            f"`bricksrl learn {quoted(file)} --look` says what it can"
        ) from None
