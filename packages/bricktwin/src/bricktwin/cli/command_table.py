"""Commands of ``bricktwin``."""

from brickhub.cli.app import CommandLine
from bricktwin import __version__

LINE = CommandLine(
    "bricktwin",
    __version__,
    """Bodies for Pybricks robots: physics, building plans, films.

Examples:
  bricktwin run main.py --robot walker --video walk.mp4
  bricktwin run follow.py --scene line-simple
  bricktwin plan check my_robot.ldr
  bricktwin run --help
  bricktwin --version
""",
    {
        "run": "bricktwin.cli.run_command:Run",
        "site": "bricktwin.cli.site_command:MakeSite",
    },
    {
        "plan": (
            "Building plans: check an LDraw file, list its parts, draw its booklet.",
            {
                "check": "bricktwin.cli.plan_commands:CheckPlan",
                "parts": "bricktwin.cli.plan_commands:PlanParts",
                "steps": "bricktwin.cli.plan_commands:PlanSteps",
            },
        ),
        "world": (
            "Worlds: the scenes of --scene, pictures as floors.",
            {
                "list": "bricktwin.cli.world_commands:ListWorlds",
                "check": "bricktwin.cli.world_commands:CheckWorld",
                "draw": "bricktwin.cli.world_commands:DrawWorlds",
                "straighten": "bricktwin.cli.world_commands:StraightenPhoto",
            },
        ),
        "twin": (
            (
                "The twin of a robot: measure the robot, record its motion, fit the twin's "
                "physics to it."
            ),
            {
                "measure": "bricktwin.cli.twin:Measure",
                "record": "bricktwin.cli.twin:RecordMotion",
                "fit": "bricktwin.cli.twin:FitTwin",
            },
        ),
    },
)
