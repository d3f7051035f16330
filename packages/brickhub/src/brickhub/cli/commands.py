"""Commands of ``brickhub``."""

from __future__ import annotations

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
""",
    {
        "run": "brickhub.cli.run:Run",
        "check": "brickhub.cli.tools:Check",
        "scan": "brickhub.cli.tools:Scan",
        "program": "brickhub.cli.tools:Program",
        "latency": "brickhub.cli.tools:Latency",
        "calibrate": "brickhub.cli.tools:Calibrate",
        "stop": "brickhub.cli.tools:Stop",
        "doctor": "brickhub.cli.doctor:Doctor",
    },
)
