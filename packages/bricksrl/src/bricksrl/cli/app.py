"""Commands of ``bricksrl``."""

from functools import partial

from brickhub.cli import app, command_table
from brickhub.cli.app import CommandLine
from bricksrl import __version__
from bricktwin.cli import command_table as of_twins

_OF_HUBS = command_table.LINE.commands
_OF_TWINS = of_twins.LINE.groups
"""Commands of the other houses, which are handed through."""

LINE = CommandLine(
    "bricksrl",
    __version__,
    """Reinforcement learning on LEGO robots that run Pybricks.

Without a robot, everything runs on a virtual hub, which executes the same hub program in simulated time.

Examples:
  bricksrl demo
  bricksrl list
  bricksrl train RunAway-v0
  bricksrl evaluate runs/<folder>
  bricksrl train --help
  bricksrl --version
""",  # noqa: E501
    {
        "list": "bricksrl.cli.envs:List",
        "train": "bricksrl.cli.train:Train",
        "learn": "bricksrl.cli.learn_command:Learn",
        "train-offline": "bricksrl.cli.train:TrainOffline",
        "team": "bricksrl.cli.team_command:TrainTeam",
        "resume": "bricksrl.cli.train:Resume",
        "tune": "bricksrl.cli.tune:Tune",
        "evaluate": "bricksrl.cli.evaluate:Evaluate",
        "page": "bricksrl.cli.page:ShowStart",
        "demo": "bricksrl.cli.page:Demo",
        "play": "bricksrl.cli.page:Play",
        "drive": "bricksrl.cli.page:DriveRobot",
        "compare": "bricksrl.cli.evaluate:Compare",
        "plot": "bricksrl.cli.evaluate:Plot",
        "export": "bricksrl.cli.evaluate:Export",
        "record": "bricksrl.cli.record:Record",
        "settings": "bricksrl.cli.envs:ShowSettings",
        "check": "bricksrl.cli.envs:Check",
        "doctor": "bricksrl.cli.doctor:Doctor",
        "trust": "bricksrl.cli.evaluate:Trust",
    },
    {
        "hub": (
            "Hubs: find, check, calibrate and stop one; print its program; run your own programs.",
            {
                name: _OF_HUBS[name]
                for name in ("scan", "check", "latency", "calibrate", "stop", "program")
            }
            | {"run": "bricksrl.cli.hub_run:Run"},
        ),
        "data": (
            "Datasets: inspect, repair, merge, split, correct, import, export and share them.",
            {
                "info": "bricksrl.cli.data:Info",
                "check": "bricksrl.cli.data:CheckData",
                "repair": "bricksrl.cli.data:Repair",
                "merge": "bricksrl.cli.data:Merge",
                "split": "bricksrl.cli.data:Split",
                "keep": "bricksrl.cli.data:Keep",
                "remove": "bricksrl.cli.data:Remove",
                "plot": "bricksrl.cli.data:PlotData",
                "import": "bricksrl.cli.data:Import",
                "export": "bricksrl.cli.data:ExportData",
                "push": "bricksrl.cli.data:Push",
                "pull": "bricksrl.cli.data:Pull",
            },
        ),
        "camera": (
            "The camera of a task: calibrate its colors.",
            {"calibrate": "bricksrl.cli.camera_command:CalibrateCamera"},
        ),
        "plan": (
            (
                "Building plans: check an LDraw file, list its parts, draw its booklet, show it in "
                "the browser."
            ),
            {**_OF_TWINS["plan"][1], "show": "bricksrl.cli.page:ShowPlan"},
        ),
        "new": (
            (
                "Templates: write a commented Python file as a start for your own task, robot or "
                "algorithm."
            ),
            {
                "task": "bricksrl.cli.new:NewTask",
                "robot": "bricksrl.cli.new:NewRobot",
                "agent": "bricksrl.cli.new:NewAgent",
            },
        ),
        "twin": _OF_TWINS["twin"],
    },
    spelling={
        "bricktwin plan": "bricksrl plan",
        "bricktwin twin": "bricksrl twin",
        "bricktwin run": "bricksrl hub run",
        "brickhub (check|program|latency|calibrate) my_robot.py": r"bricksrl hub \2 RunAway-v0",
        "brickhub": "bricksrl hub",
    },
    instead={"--robot": "--option robot=NAME"},
)

run = partial(app.run, LINE)
parse = partial(app.parse, LINE)
"""Run, and parse, the command that these arguments name."""
