"""The tree of commands, and what becomes of their errors."""

from __future__ import annotations

import io
import os
import re
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
_DATA = "Datasets: look at them, mend, join and split them, bring them in and out, share them."
_HUB = "A hub: find, check, calibrate and stop it; its program; programs of your own on a virtual hub."
_CAMERA = "The camera of a task: find out what counts as red before it."

_TWIN = "The twin of a robot: record what a robot does, fit the twin to it."


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
            print_error(one_line(complaint.getvalue()))
        raise
    return cast(Command, parsed)


def _commands(arguments: Sequence[str]) -> SubcommandApp:
    def add(app: SubcommandApp, name: str, command: type) -> None:
        text = cleandoc(command.__doc__ or "")
        # All of it in the command's own help, its first line in the list of commands.
        app.command(name=name, help=text if name in arguments else text.partition("\n")[0])(command)

    hub = SubcommandApp()
    add(hub, "scan", Scan)
    add(hub, "check", CheckHub)
    add(hub, "latency", Latency)
    add(hub, "calibrate", Calibrate)
    add(hub, "stop", Stop)
    add(hub, "rename", Rename)
    add(hub, "program", Program)
    add(hub, "run", Run)
    app = SubcommandApp()
    add(app, "list", List)
    add(app, "train", Train)
    add(app, "train-offline", TrainOffline)
    add(app, "resume", Resume)
    add(app, "tune", Tune)
    add(app, "evaluate", Evaluate)
    add(app, "record", RecordDataset)
    add(app, "check", Check)
    add(app, "doctor", Doctor)
    app.command(hub, name="hub", help=_HUB)
    datasets = SubcommandApp()
    for name, command in data.COMMANDS.items():
        add(datasets, name, command)
    app.command(datasets, name="data", help=_DATA)
    camera = SubcommandApp()
    add(camera, "calibrate", CalibrateCamera)
    app.command(camera, name="camera", help=_CAMERA)
    twin = SubcommandApp()
    add(twin, "record", Record)
    add(twin, "fit", Fit)
    app.command(twin, name="twin", help=_TWIN)
    return app


def one_line(box: str) -> str:
    """What tyro says in a box of several lines, as one: its first paragraph, and whose help to read."""
    lines = [line.strip("│╭╮╰╯─ ") for line in box.splitlines()[1:]]
    message, _, rest = "\n".join(lines).partition("\n\n")
    found = re.search(r"(bricksrl[a-z ]*?) --help", rest)
    return f"{' '.join(message.split()).removesuffix('.')}; see `{found[1] if found else 'bricksrl'} --help`"
