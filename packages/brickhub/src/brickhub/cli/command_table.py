"""Commands of ``brickhub``."""

from brickhub import __version__
from brickhub.cli.app import CommandLine

LINE = CommandLine(
    "brickhub",
    __version__,
    """Pybricks hubs, real and virtual: run programs without a hub, and talk to one over Bluetooth or USB.

Examples:
  brickhub run main.py
  brickhub run main.py --hub ble
  brickhub scan
  brickhub run --help
  brickhub --version
""",  # noqa: E501
    {
        "run": "brickhub.cli.run_command:Run",
        "check": "brickhub.cli.hub_tools:Check",
        "scan": "brickhub.cli.hub_tools:Scan",
        "program": "brickhub.cli.hub_tools:Program",
        "latency": "brickhub.cli.hub_tools:MeasureLatency",
        "calibrate": "brickhub.cli.hub_tools:Calibrate",
        "stop": "brickhub.cli.hub_tools:Stop",
        "doctor": "brickhub.cli.doctor:Doctor",
    },
)
