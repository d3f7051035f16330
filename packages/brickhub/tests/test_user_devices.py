"""Devices of a user's own on a command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.errors import DescriptionError, UnknownNameError
from brickhub.user_devices import is_own_device, load_own_device

SOURCE = """from brickhub.virtual.own_devices import OwnDevice, OwnMode
GAUGE = OwnDevice(70, (OwnMode("value", lambda time_s: (1,)),))
NUMBER = 3
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_device.py"
    path.write_text(SOURCE)
    return path


def test_file_is_told_from_a_kind_of_device() -> None:
    assert is_own_device("A=my_device.py:GAUGE") and is_own_device("A = my_device.py")
    assert not is_own_device("A=ColorSensor") and not is_own_device("A=nothing")


@pytest.mark.parametrize(("port", "known"), [("A", "A"), ("b ", "B"), ("S2", "2")])
def test_device_of_a_file_is_on_its_port(file: Path, port: str, known: str) -> None:
    found, device = load_own_device(f"{port}={file}:GAUGE")
    assert found == known and device.id == 70
    assert load_own_device(f"{port}={file}")[0] == known, "the only one of the file"


def test_what_is_no_device_or_has_no_port_is_refused(file: Path) -> None:
    with pytest.raises(DescriptionError, match="is no OwnDevice, OwnUart or OwnI2c; name one"):
        load_own_device(f"A={file}:NUMBER")
    with pytest.raises(DescriptionError, match="names no port; give one such as"):
        load_own_device(f"={file}:GAUGE")
    with pytest.raises(UnknownNameError):
        load_own_device(f"A={file}:NOTHING")
