"""``bricksrl learn``: from the drawing of a robot to what it has learned."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional

from brickhub.cli.terminal import choose, print_line, print_note
from brickhub.fields import Range
from brickhub.files import quoted
from brickhub.options import Existing, Flag, Seed, option
from brickhub.user_files import NotCode, check_there, without_name
from bricksrl.cli.page import LivePageGroup, PageFlag
from bricksrl.cli.terminal import telling
from bricksrl.cli.train import FilmFlag, Train, run_folder
from bricksrl.envs.options import EnvOptions
from bricksrl.errors import BricksError, DescriptionError, counted
from bricksrl.page.server import PageOptions
from bricksrl.training.config import RunOptions
from bricksrl.training.run_folder import RunFolder
from bricktwin.robots.planned import is_plan
from bricktwin.target import load_scene

if TYPE_CHECKING:
    from bricksrl.envs.abilities.of_plans import Offer
    from bricktwin.robots.as_drawn import DrawnRobot

_WORSE = 0.25
"""Share of its return that a policy may lose on the hub before that is said."""
_PROGRAM = "on_the_hub.py"
"""The exported program, in the folder of the run."""


@dataclass(frozen=True)
class Learn:
    """Say what the robot of a building plan can learn, and let it learn that.

    The plan is an LDraw file (.ldr, .mpd) or a file of Studio (.io). Hub, motors and what each
    turns, sensors and where they look come from the drawing. The run folder gets a film, a report,
    and the program with which the real robot acts by itself. `bricksrl train my_robot.ldr:walk`
    is the same training with all of its options.

    Examples:
      bricksrl learn examples/15_six_legs.ldr
      bricksrl learn my_robot.ldr:walk --page
      bricksrl learn my_robot.io --look
    """

    plan: Annotated[Positional[str], option(metavar="PLAN[:GOAL]"), Existing(check_there)]
    """Building plan of the robot, and what it is to learn; without a goal you are asked, or it
    learns what suits it best."""
    look: Flag = False
    """Only say what the plan shows, and what the robot can learn."""
    json: Flag = False
    """With --look: print one JSON object instead of lines."""
    episodes: Annotated[int | None, Range(1), option(metavar="N")] = None
    """Episodes to train for; the default depends on the goal."""
    seed: Seed = 0
    """Seed of all random numbers: the same seed gives the same run."""
    run: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder to write to, which must not exist; by default runs/<plan>-<goal>-..."""
    scene: Annotated[str | None, option(metavar="SCENE"), Existing(load_scene)] = None
    """Where it learns, in place of the goal's own surroundings: a world, a picture or a photograph
    of a mat with its size, as of `bricksrl train`."""
    name: Annotated[str, option(metavar="NAME"), NotCode()] = ""
    """Name of the pupil or the group, for report and comparisons."""
    page: PageFlag = False
    film: FilmFlag = True
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        if self.json and not self.look:
            raise DescriptionError("--json has no effect without --look; give both, or neither")
        file = without_name(self.plan)
        if not is_plan(file):
            raise DescriptionError(
                f"{file} is no building plan; give a file that ends in .ldr, .mpd or .io"
            )
        # Reading plans imports NumPy and more, so the file's name is checked before.
        from bricksrl.envs.abilities.of_plans import offers, task_of_plan
        from bricktwin.robots.as_drawn import robot_as_drawn

        has_goal = self.plan != file
        if has_goal:
            # It raises for a goal that this robot cannot learn.
            task_of_plan(self.plan)
        drawn = robot_as_drawn(file)
        offered = offers(drawn)
        if self.json:
            print_line(json.dumps(_as_json(drawn, offered)))
            return
        _say(drawn, offered)
        if self.look:
            return
        reference = self.plan if has_goal else f"{file}:{_chosen(file, offered)}"
        train = Train(
            env=reference,
            episodes=self.episodes,
            seed=self.seed,
            learning=RunOptions(name=self.name),
            robot=EnvOptions(scene=self.scene),
            page=self.page,
            film=self.film,
            live_page=self.live_page,
        )
        folder = self.run
        if folder is None:
            agent = train.config(reference).agent
            folder = run_folder(None, reference, agent, self.seed)
        replace(train, run=folder).execute()
        _say_if_nothing_was_learned(folder)
        _export(folder, reference)


def _as_json(drawn: DrawnRobot, offered: list[Offer]) -> dict[str, Any]:
    """What was found, as plain values."""
    motors: list[dict[str, str]] = []
    for motor in drawn.motors:
        facts = motor.facts
        motors.append(
            {"name": motor.name, "port": facts.port, "part": facts.part, "moves": motor.moves}
        )
    sensors: list[dict[str, str]] = []
    for sensor in drawn.sensors:
        seen = sensor.facts
        sensors.append(
            {"name": sensor.name, "port": seen.port, "part": seen.part, "looks": seen.looks}
        )
    abilities: list[dict[str, str]] = []
    for offer in offered:
        ability = offer.ability
        abilities.append(
            {
                "name": ability.name,
                "sentence": ability.sentence,
                "reason": offer.reason,
                "remark": offer.remark,
            }
        )
    return {
        "robot": drawn.robot.name,
        "hub": drawn.hub.part,
        "motors": motors,
        "sensors": sensors,
        "notes": _notes(drawn),
        "abilities": abilities,
    }


def _notes(drawn: DrawnRobot) -> list[str]:
    """What a builder has to know of a drawing before its robot learns."""
    from bricktwin.plans.planned_robot import planned_robot
    from bricktwin.twin.models.balance import IN_THE_AIR, balance_of, turns_wheels_in_the_air

    notes = [f"{drawn.robot.name}, {lack}." for lack in drawn.lacks]
    robot = planned_robot(drawn.path)
    balance = balance_of(robot)
    if balance is not None and balance.fault is not None:
        notes.append(f"{drawn.robot.name}: {balance.fault}.")
    if turns_wheels_in_the_air(robot):
        notes.append(f"{drawn.robot.name}: {IN_THE_AIR}.")
    if not drawn.is_wired and (drawn.motors or drawn.sensors):
        notes.append(
            "The plan says no ports, so they are given in the order of building: plug the cables "
            "in so, or write 0 !BRICKSRL PORT A before each motor and sensor."
        )
    return notes


def _say(drawn: DrawnRobot, offered: list[Offer]) -> None:
    """Print what was found, and what the robot can learn."""
    motors = counted(len(drawn.motors), "motor")
    sensors = counted(len(drawn.sensors), "sensor")
    print_line(f"{drawn.robot.name}: {drawn.hub.part}, {motors}, {sensors}")
    for motor in drawn.motors:
        facts = motor.facts
        print_line(f"  port {facts.port}  {motor.name:13} {facts.part}: {motor.moves}")
    for sensor in drawn.sensors:
        seen = sensor.facts
        looks = f"looks {seen.looks}" if seen.looks else "looks askew"
        print_line(f"  port {seen.port}  {sensor.name:13} {seen.part}: {looks}")
    for note in _notes(drawn):
        print_note(note)
    can = [offer for offer in offered if offer.task is not None]
    cannot = [offer for offer in offered if offer.task is None]
    if can:
        print_line("It can learn")
    for offer in can:
        remark = f" ({offer.remark})" if offer.remark else ""
        print_line(f"  {offer.ability.name:7} {offer.ability.sentence}{remark}")
    if cannot:
        print_line("It cannot learn")
    for offer in cannot:
        print_line(f"  {offer.ability.name:7} {offer.ability.sentence}: {offer.reason}")


def _chosen(plan: str, offered: list[Offer]) -> str:
    """The goal that the user chooses, or the one that suits the robot best. Raises DescriptionError
    if there is none."""
    names = [offer.ability.name for offer in offered if offer.task is not None]
    if not names:
        raise DescriptionError(
            f"the robot of {plan} can learn nothing as it is drawn; the lines above say what it "
            "lacks"
        )
    return names[0] if len(names) == 1 else choose("What is it to learn?", names, names[0])


def _say_if_nothing_was_learned(folder: Path) -> None:
    """Say it where no episode of the evaluation succeeded."""
    run = RunFolder(folder)
    evaluation = run.own_evaluation(len(run.read_episodes()))
    if evaluation is not None and evaluation["success_rate"] == 0.0:
        episodes = 2 * len(run.read_episodes())
        print_note(
            "It has not learned this: no episode succeeded. Look at the film; then train longer, "
            f"`bricksrl resume {quoted(folder)} --episodes {episodes}`, or change the robot."
        )


def _export(folder: Path, reference: str) -> None:
    """Write the program for the hub beside the run, and say how it does there; what a hub cannot do
    is said."""
    from bricksrl.policies.hub_export import export_program

    out = folder / _PROGRAM
    try:
        with telling("writing the program for the hub"):
            exported = export_program(folder, out)
    except BricksError as error:
        print_note(f"There is no program for the hub: {error}.")
        return
    print_line(f"for the hub     {out}")
    print_line(
        f"                a return of {exported.hub_return:.3g} on the virtual hub by itself, "
        f"{exported.policy_return:.3g} over the link"
    )
    lost = exported.policy_return - exported.hub_return
    if lost > _WORSE * abs(exported.policy_return):
        print_note(
            "By itself it does far worse than over the link: train longer, as what it has learned "
            "may hold only for the way in which it was tried."
        )
    print_line(f"run it          bricksrl hub run {quoted(out)} --robot {quoted(reference)}")
