"""`benchmarks/pybricks_api.py` reports missing documented methods."""

from __future__ import annotations

from pathlib import Path

from benchmarks import pybricks_api
from brickhub.robot import HubKind

COMMON = """
class Battery:
    def voltage(self): ...
    def taste(self): ...
class Device:
    def info(self): ...
    def sing(self, song): ...
"""
HUBS = """
from . import _common
class PrimeHub:
    battery = _common.Battery()
    nose = _common.Battery()
class EV3Brick:
    pass
"""
PUPDEVICES = """
class Motor(_common.Device):
    def run(self, speed): ...
    def run_time(self, time, speed): ...
class Laser: ...
"""
FILES = {
    "_common": COMMON,
    "hubs": HUBS,
    "pupdevices": PUPDEVICES,
    "robotics": "",
    "tools": "def wait(time): ...\ndef sleep(time): ...\ndef _hidden(): ...\n",
    "parameters": "class Stop:\n    HOLD = 1\n    DANCE = 2\nclass Port:\n    A = 1\n    S1 = 2\n",
    "iodevices": "class LUMPDevice: ...\n",
}


def test_missing_api_is_reported(tmp_path: Path) -> None:
    (tmp_path / "pybricks").mkdir()
    for name, source in FILES.items():
        (tmp_path / "pybricks" / f"{name}.py").write_text(source)
    _, missing = pybricks_api.compared(pybricks_api.Stubs(tmp_path), HubKind.PRIME)
    assert missing == [
        "hubs.PrimeHub.battery.taste",
        "hubs.PrimeHub.nose",
        "pupdevices.Motor.info",
        "pupdevices.Motor.sing",
        "pupdevices.Motor.run_time(time, speed)",
        "pupdevices.Laser",
        "tools.sleep",
        "parameters.Stop.DANCE",
    ]
