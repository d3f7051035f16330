"""``bricksrl twin``: record what a robot does, and fit its twin to that."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from bricksrl.cli.console import print_line
from bricksrl.errors import TwinError

# Written out here, because the fit itself takes a second to import.
FITTED = ("battery_v", "friction_scale", "motor_friction_scale", "mass_scale", "backlash_deg")

if TYPE_CHECKING:
    from bricksrl.twin.fit import Fit as FitResult


@dataclass(frozen=True)
class Record:
    """Let a robot make the moves that tell the most about it, and write what its hub answers.

    Give it a metre of free floor: it stands still for a second, jerks, then runs at full speed, about ten seconds in all.

    Examples:
      bricksrl twin record two-wheeler --out robot.jsonl
      bricksrl twin record walker --steps 200 --out walker.jsonl
    """

    robot: Annotated[Positional[str], arg(metavar="ROBOT")]
    """Robot; `bricksrl list` shows them."""
    out: Annotated[Path, arg(metavar="FILE")]
    """File to write."""
    hub: Literal["virtual"] = "virtual"
    """How to reach the robot."""
    steps: Annotated[int, arg(metavar="N")] = 120
    """Commands, twenty a second."""
    seed: Annotated[int, arg(metavar="N")] = 0
    """Of the moves."""
    physics: Annotated[Path | None, arg(metavar="FILE")] = None
    """Physics of a virtual robot: a JSON file such as `bricksrl twin fit` writes."""

    def execute(self) -> int:
        """Record and write."""
        import numpy as np

        from bricksrl import robots
        from bricksrl.hub.link import HubLink
        from bricksrl.twin.log import identification_commands, identification_interface, record, write_log
        from bricksrl.twin.physics import read_physics
        from bricksrl.twin.virtual_hub import VirtualHub

        if self.steps < 1 or self.seed < 0:
            raise TwinError(f"steps is {self.steps} and seed {self.seed}; give at least 1 step, and a seed of 0 or more")
        robot = robots.get(self.robot)
        interface = identification_interface(robot)
        commands = identification_commands(interface, self.steps, np.random.default_rng(self.seed))
        physics = None if self.physics is None else read_physics(self.physics)
        with HubLink(VirtualHub(robot, physics=physics, seed=self.seed), robot, interface) as link:
            log = record(link, robot, interface, commands)
        write_log(self.out, log)
        seconds = (log.times_ms[-1] - log.times_ms[0]) / 1000
        print_line(f"{len(log.commands)} commands in {seconds:.1f} s of {robot.name}: {self.out}")
        return 0


@dataclass(frozen=True)
class Fit:
    """Fit the physics of a twin to a recorded run, and say how well the twin moved before and after.

    Takes about two minutes for ten seconds of log. `bricksrl train ENV --physics FILE` then uses what it found.

    Examples:
      bricksrl twin fit robot.jsonl
      bricksrl twin fit robot.jsonl --out robot.json
    """

    log: Annotated[Positional[Path], arg(metavar="LOG")]
    """File that `bricksrl twin record` wrote."""
    robot: Annotated[str | None, arg(metavar="ROBOT")] = None
    """Robot, when it is not the one that the log names."""
    parameters: Annotated[tuple[str, ...], arg(metavar="NAME")] = FITTED
    """Parameters to look for; those that you know stay out."""
    out: Annotated[Path | None, arg(metavar="FILE")] = None
    """File for the physics; without it the log's name with the ending .physics.json."""

    def execute(self) -> int:
        """Fit, print, write."""
        from bricksrl import robots
        from bricksrl.twin.fit import fit
        from bricksrl.twin.log import read_log
        from bricksrl.twin.physics import write_physics

        log = read_log(self.log)
        robot = robots.get(self.robot or log.robot)
        found = fit(log, robot=robot, names=self.parameters, on_replay=_tell)
        _tell_end()
        out = self.out or self.log.with_suffix(".physics.json")
        write_physics(out, found.physics)
        _print(found)
        print_line(f"physics  {out}")
        return 0


def _print(found: FitResult) -> None:
    from bricksrl.twin.physics import PARAMETERS, Physics

    print_line("error of the twin (root mean square)")
    for name, before in found.error_before.items():
        print_line(f"  {name:24}{before:8.3g} -> {found.error_after[name]:.3g}")
    print_line("parameters")
    default = Physics()
    for name, parameter in PARAMETERS.items():
        value, was = getattr(found.physics, name), getattr(default, name)
        if name in found.told or value != was:
            print_line(f"  {name:24}{was:8.3g} -> {value:.3g} {parameter.unit.removesuffix('1')}".rstrip())
    for name in found.untold:
        print_line(f"  {name:24}{getattr(default, name):8.3g}    this log does not tell it")


def _tell(replay: int, error: float) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\rreplay {replay}, error {error:.3g} ")
        sys.stderr.flush()


def _tell_end() -> None:
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
