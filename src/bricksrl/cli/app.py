"""The tree of commands, and what becomes of their errors."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr
from inspect import cleandoc
from typing import Protocol, cast

from tyro.conf import FlagCreatePairsOff
from tyro.extras import SubcommandApp

import bricksrl
from bricksrl.cli import data
from bricksrl.cli.camera import CalibrateCamera
from bricksrl.cli.check import Check
from bricksrl.cli.console import print_error, print_line
from bricksrl.cli.doctor import Doctor
from bricksrl.cli.evaluate import Evaluate
from bricksrl.cli.hub import Program, Run
from bricksrl.cli.hub_tools import Calibrate, CheckHub, Latency, Rename, Scan, Stop
from bricksrl.cli.listing import List
from bricksrl.cli.offline import TrainOffline
from bricksrl.cli.record import Record as RecordDataset
from bricksrl.cli.train import Resume, Train
from bricksrl.cli.tune import Tune
from bricksrl.cli.twin import Fit, Record
from bricksrl.errors import BricksError

_DESCRIPTION = """Reinforcement learning on LEGO robots that run Pybricks.

Without a robot at hand, everything runs on a virtual hub: the very program of the hub, in simulated time.

Examples:
  bricksrl list
  bricksrl train RunAway-v0
  bricksrl evaluate runs/<folder>
  bricksrl train --help
  bricksrl --version
"""
_COMMANDS: dict[str, type] = {
    "list": List,
    "train": Train,
    "train-offline": TrainOffline,
    "resume": Resume,
    "tune": Tune,
    "evaluate": Evaluate,
    "record": RecordDataset,
    "check": Check,
    "doctor": Doctor,
}
_HUB: dict[str, type] = {
    "scan": Scan,
    "check": CheckHub,
    "latency": Latency,
    "calibrate": Calibrate,
    "stop": Stop,
    "rename": Rename,
    "program": Program,
    "run": Run,
}
_GROUPS: dict[str, tuple[str, dict[str, type]]] = {
    "hub": ("A hub: find, check, calibrate and stop it; its program; programs of your own on a virtual hub.", _HUB),
    "data": ("Datasets: look at them, mend, join and split them, bring them in and out, share them.", data.COMMANDS),
    "camera": ("The camera of a task: find out what counts as red before it.", {"calibrate": CalibrateCamera}),
    "twin": ("The twin of a robot: record what a robot does, fit the twin to it.", {"record": Record, "fit": Fit}),
}


class Command(Protocol):
    """One parsed command line."""

    def execute(self) -> int:
        """Do it and return the exit code."""


def run(arguments: Sequence[str]) -> int:
    """Parse the arguments and run the command; an error of ours becomes one line on standard error."""
    if list(arguments) == ["--version"]:
        print_line(f"bricksrl {bricksrl.__version__}")
        return 0
    try:
        return parse(arguments).execute()
    except BricksError as error:
        print_error(str(error))
        return 2
    except BrokenPipeError:  # who read our output, such as `head`, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print_error(f"{error.filename or 'this computer'}: {error.strerror or error}")
        return 2


def parse(arguments: Sequence[str]) -> Command:
    """The command that the arguments name; exits like argparse for help, and for arguments that are wrong."""
    complaint = io.StringIO()
    try:
        with redirect_stderr(complaint):
            parsed = _commands(arguments).cli(
                prog="bricksrl", description=_DESCRIPTION, args=arguments, config=(FlagCreatePairsOff,)
            )
    except SystemExit as end:
        if end.code:
            print_error(one_line(complaint.getvalue(), addressed(arguments)))
        raise
    return cast(Command, parsed)


def _commands(arguments: Sequence[str]) -> SubcommandApp:
    def add(app: SubcommandApp, name: str, command: type) -> None:
        text = cleandoc(command.__doc__ or "")
        # All of it in the command's own help, its first line in the list of commands.
        app.command(name=name, help=text if name in arguments else text.partition("\n")[0])(command)

    app = SubcommandApp()
    for name, command in _COMMANDS.items():
        add(app, name, command)
    for name, (text, commands) in _GROUPS.items():
        group = SubcommandApp()
        for part, command in commands.items():
            add(group, part, command)
        app.command(group, name=name, help=text)
    return app


def addressed(arguments: Sequence[str]) -> str:
    """The command that is meant, as far as there is one: ``bricksrl``, ``bricksrl train`` or ``bricksrl hub scan``."""
    words = ["bricksrl"]
    if arguments and arguments[0] in {*_COMMANDS, *_GROUPS}:
        words.append(arguments[0])
        group = _GROUPS.get(arguments[0])
        if group and arguments[1:] and arguments[1] in group[1]:
            words.append(arguments[1])
    return " ".join(words)


def one_line(box: str, command: str = "bricksrl") -> str:
    """What tyro says in a box of several lines, as one: its first paragraph, and whose help to read."""
    lines = [line.strip("│╭╮╰╯─ ") for line in box.splitlines()[1:]]
    message = "\n".join(lines).partition("\n\n")[0]
    return f"{' '.join(message.split()).removesuffix('.')}; see `{command} --help`"
