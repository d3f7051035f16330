"""`benchmarks/pybricks_api.py` reports missing documented methods."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

from brickhub.robot import HubKind

BENCHMARKS = Path(__file__).parents[5] / "benchmarks"
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


@pytest.fixture
def api(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return runpy.run_path(str(BENCHMARKS / "pybricks_api.py"), run_name="pybricks_api")


def test_missing_api_is_reported(api: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "pybricks").mkdir()
    for name, source in FILES.items():
        (tmp_path / "pybricks" / f"{name}.py").write_text(source)
    _, missing = api["compared"](api["Stubs"](tmp_path), HubKind.PRIME)
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
