"""Tree of commands, and handling of their errors."""

from __future__ import annotations

import errno
import importlib
import io
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from inspect import cleandoc
from typing import Protocol, cast

import tyro
from tyro.conf import FlagCreatePairsOff
from tyro.extras import SubcommandApp

import bricksrl
from brickhub.cli.terminal import Interrupted, print_error, print_line, print_note
from brickhub.cli.wording import one_line
from brickhub.errors import BricksError

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""
_DESCRIPTION = """Reinforcement learning on LEGO robots that run Pybricks.

Without a robot, everything runs on a virtual hub, which executes the same hub program in simulated time.

Examples:
  bricksrl list
  bricksrl train RunAway-v0
  bricksrl evaluate runs/<folder>
  bricksrl train --help
  bricksrl --version
"""
# Each command as "module:class" below `bricksrl.cli`; a module is imported when its command is named.
_COMMANDS = {
    "list": "envs:List",
    "train": "train:Train",
    "train-offline": "offline:TrainOffline",
    "team": "team:TrainTeam",
    "resume": "train:Resume",
    "tune": "tune:Tune",
    "study": "study:StudyCommand",
    "evaluate": "evaluate:Evaluate",
    "play": "page:Play",
    "drive": "page:DriveRobot",
    "compare": "compare:Compare",
    "plot": "compare:Plot",
    "export": "export:Export",
    "record": "record:Record",
    "settings": "settings:ShowSettings",
    "check": "check:Check",
    "doctor": "doctor:Doctor",
    "trust": "trust:Trust",
}
_HUB = {
    "scan": "hub_tools:Scan",
    "check": "hub_tools:CheckHub",
    "latency": "hub_tools:Latency",
    "calibrate": "hub_tools:Calibrate",
    "stop": "hub_tools:Stop",
    "rename": "hub_tools:Rename",
    "program": "hub:Program",
    "run": "hub:Run",
}
_DATA = {
    "info": "data:Info",
    "check": "data:CheckData",
    "repair": "data:Repair",
    "merge": "data:Merge",
    "split": "data:Split",
    "plot": "data:PlotData",
    "import": "data:Import",
    "export": "data:ExportData",
    "push": "data:Push",
    "pull": "data:Pull",
}
_GROUPS = {
    "hub": ("Hubs: find, check, calibrate and stop one; print its program; run your own programs.", _HUB),
    "data": ("Datasets: inspect, repair, merge, split, import, export and share them.", _DATA),
    "camera": ("The camera of a task: calibrate its colors.", {"calibrate": "camera:CalibrateCamera"}),
    "plan": (
        "Building plans: check an LDraw file, list its parts, draw its booklet, show it in the browser.",
        {"check": "plan:CheckPlan", "parts": "plan:PlanParts", "steps": "plan:PlanSteps", "show": "plan:ShowPlan"},
    ),
    "new": (
        "Templates: write a commented Python file as a start for your own task, robot or algorithm.",
        {"task": "new:NewTask", "robot": "new:NewRobot", "agent": "new:NewAgent"},
    ),
    "twin": (
        "The twin of a robot: record the robot's motion, fit the twin's physics to it.",
        {"record": "twin:RecordMotion", "fit": "twin:FitTwin"},
    ),
}


class ParsedCommand(Protocol):
    """One parsed command line."""

    def execute(self) -> int | None:
        """Run the command; returns its exit code, ``None`` for 0. Raises Interrupted if the user ends it."""


def run(arguments: Sequence[str]) -> int:
    """Parse the arguments and run the command; a `BricksError` becomes one line on standard error."""
    try:
        if list(arguments) == ["--version"]:
            print_line(f"bricksrl {bricksrl.__version__}")
            return 0
        if not arguments or arguments[0] == "help":
            arguments = [*command_words(arguments[1:]), "--help"]
        return parse(arguments).execute() or 0
    except Interrupted as end:
        if str(end):
            print_note(f"interrupted: {end}")
        return INTERRUPTED
    except BricksError as error:
        print_error(str(error))
        return 2
    except BrokenPipeError:  # the reader of our output, such as `head`, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        subject = f"{error.filename}: " if error.filename else ""
        remedy = "make room on the disk" if error.errno == errno.ENOSPC else "look whether it is there and you may use it"
        print_error(f"{subject}{error.strerror or error}; {remedy}")
        return 2
    except MemoryError:
        print_error("this computer has not enough memory for that; ask for less")
        return 2
    except Exception as error:
        from bricksrl.envs.user_files import failure_of_user

        message = failure_of_user(error) or _missing_package(error)
        if message is None:
            raise  # a bug of ours: show the traceback
        print_error(message)
        return 2


def _missing_package(error: Exception) -> str | None:
    """One-line message if a package that we need is not installed; ``None`` for any other error."""
    package = (getattr(error, "name", None) or "bricksrl").partition(".")[0]
    if not isinstance(error, ModuleNotFoundError) or package == "bricksrl":
        return None
    return f"the package '{package}' is missing in {sys.prefix}; install BricksRL there again, or activate its environment"


def parse(arguments: Sequence[str]) -> ParsedCommand:
    """Parse the arguments into a command; exits like argparse for help and for invalid arguments."""
    words = command_words(arguments)
    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            parsed = _parse(words, arguments[len(words) :])
    except SystemExit as end:
        if end.code:
            print_error(one_line(messages.getvalue(), " ".join(["bricksrl", *words])))
        raise
    return cast(ParsedCommand, parsed)


def _parse(words: Sequence[str], arguments: Sequence[str]) -> object:
    """Parse with the parser of the named command only, as a parser of all would have to import every command."""
    prog, config = " ".join(["bricksrl", *words]), (FlagCreatePairsOff,)
    if not words:
        return _overview().cli(prog=prog, description=_DESCRIPTION, args=arguments, config=config)
    if words[0] in _COMMANDS or len(words) == 2:
        command = _load(_COMMANDS[words[0]] if len(words) == 1 else _GROUPS[words[0]][1][words[1]])
        return tyro.cli(command, prog=prog, description=cleandoc(command.__doc__ or ""), args=arguments, config=config)
    text, commands = _GROUPS[words[0]]
    return _listing(commands).cli(prog=prog, description=text, args=arguments, config=config)


def _overview() -> SubcommandApp:
    app = _listing(_COMMANDS)
    for name, (text, commands) in _GROUPS.items():
        app.command(_listing(commands), name=name, help=text)
    return app


def _listing(commands: Mapping[str, str]) -> SubcommandApp:
    """A parser of commands, with the first line of their help."""
    app = SubcommandApp()
    for name, place in commands.items():
        command = _load(place)
        app.command(name=name, help=cleandoc(command.__doc__ or "").partition("\n")[0])(command)
    return app


def _load(place: str) -> type:
    module, _, name = place.partition(":")
    command: type = getattr(importlib.import_module(f"bricksrl.cli.{module}"), name)
    return command


def command_words(arguments: Sequence[str]) -> list[str]:
    """Leading words that name a command or a group: none, ``train``, or ``hub`` and ``scan``."""
    words = [word for word in arguments[:1] if word in {*_COMMANDS, *_GROUPS}]
    group = _GROUPS.get(words[0]) if words else None
    if group and arguments[1:] and arguments[1] in group[1]:
        words.append(arguments[1])
    return words
