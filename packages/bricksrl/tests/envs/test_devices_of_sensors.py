"""Devices that come with BricksRL, with a serial port that is none and a camera that is none."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bricksrl.envs.host_sensors import devices
from bricksrl.envs.host_sensors.devices import second_camera, serial_numbers
from bricksrl.envs.host_sensors.host_sensor import ThreadReader, TwinReader, World
from bricksrl.envs.vision.camera import CameraView
from bricksrl.errors import SensorError
from bricktwin.twin.scene import Scene


class Port:
    """A serial port with lines that wait, or come one after the other."""

    port = "COM3"

    def __init__(self, lines: list[str], *, wait: int) -> None:
        self.lines = list(lines)
        self.wait = wait
        self.read = 0
        self.is_closed = False

    def readline(self) -> bytes:
        self.read += 1
        return self.lines.pop(0).encode() if self.lines else b""

    @property
    def in_waiting(self) -> bool:
        return self.read < self.wait

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """How ports are opened; the last entry is the port that the next one gets."""
    asked: list[Any] = []

    def serial_for_url(address: str, baud: int, timeout: float) -> Any:
        port = asked.pop()
        asked.append((address, baud, timeout))
        return port

    serial = SimpleNamespace(serial_for_url=serial_for_url)
    monkeypatch.setitem(sys.modules, "serial", serial)
    return asked


def test_port_is_opened_as_microcontrollers_write(opened: list[Any]) -> None:
    port = Port(["half a line\n", "1\n"], wait=0)
    opened.append(port)
    device = serial_numbers("COM3")()
    assert opened == [("COM3", 115_200, 1.5)]
    assert device.read() == (1.0,), "the first line may begin in the middle"
    device.close()
    assert port.is_closed
    opened.append(Port([], wait=0))
    serial_numbers("/dev/ttyACM0", 9600)()
    assert opened[-1] == ("/dev/ttyACM0", 9600, 1.5)


@pytest.mark.parametrize(
    ("line", "numbers"),
    [
        ("21.5, 48\r\n", (21.5, 48.0)),
        ("1,2;3 4\t-5e1\n", (1.0, 2.0, 3.0, 4.0, -50.0)),
        ("  7  \n", (7.0,)),
    ],
)
def test_numbers_are_separated_in_any_way(
    opened: list[Any], line: str, numbers: tuple[float, ...]
) -> None:
    opened.append(Port(["", line], wait=0))
    assert serial_numbers("COM3")().read() == numbers


def test_newest_line_of_numbers_counts_and_words_are_skipped(opened: list[Any]) -> None:
    lines = ["", "ready\n", "1\n", "2\n", "noise\n", "3\n", "4\n"]
    # When the fifth line has been read, no other one waits.
    port = Port(lines, wait=5)
    opened.append(port)
    device = serial_numbers("COM3")()
    assert device.read() == (2.0,), "and the words behind it are skipped too"
    assert device.read() == (3.0,)
    assert port.lines == ["4\n"]


def test_silent_and_wordy_devices_are_told_apart(opened: list[Any]) -> None:
    opened.append(Port(["", "hello\n"], wait=0))
    with pytest.raises(SensorError) as caught:
        serial_numbers("COM3")().read()
    assert str(caught.value) == "COM3 says nothing for 1.5 s; look whether its program runs"
    port = Port(["", *["x" * 50 + "\n"] * 1500], wait=0)
    opened.append(port)
    with pytest.raises(SensorError) as caught:
        serial_numbers("COM3")().read()
    assert str(caught.value) == (
        f"COM3 writes no lines of numbers but '{'x' * 40}'; correct program or baud rate"
    )
    assert port.read == 1001
    flood = Port(["", *["1\n"] * 1500], wait=9999)
    opened.append(flood)
    with pytest.raises(SensorError, match="writes no lines of numbers but '1'"):
        serial_numbers("COM3")().read()


VIEW = CameraView("side", device=2, width_px=8, height_px=8, image_px=4)


class Film:
    """A camera whose frames are of one grey, one brighter each time."""

    made: list[Film] = []  # noqa: RUF012  each test sets it

    def __init__(self, *about: Any) -> None:
        self.about = about
        self.frames = 0
        self.closed = 0
        self.made.append(self)

    def frame(self) -> Any:
        self.frames += 1
        return np.full((8, 8, 3), self.frames, np.uint8)

    def close(self) -> None:
        self.closed += 1


def test_second_camera_is_one_for_all_readings_of_a_twin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Film, "made", [])
    monkeypatch.setattr(devices, "TwinCamera", Film)
    monkeypatch.setattr(devices, "VideoCamera", Film)
    sensor = second_camera(VIEW)
    assert (sensor.name, sensor.entries, sensor.image_px) == ("side", (), 4)
    assert (sensor.rate_hz, sensor.observes_age) == (30.0, False)
    world = World("pose", "body", Scene(), np.random.default_rng(0), lambda: 0.0)  # type: ignore[arg-type]
    assert sensor.twin is not None
    images = [sensor.twin(world) for _ in range(3)]
    assert [image.shape for image in images] == [(4, 4, 3)] * 3
    assert [int(image[0, 0, 0]) for image in images] == [1, 2, 3]
    first = Film.made[0]
    assert first.about == ("body", VIEW) and first.frames == 3
    TwinReader(sensor, sensor.twin, world).close()
    assert first.closed == 1
    device = sensor.open()
    assert Film.made[-1].about == (VIEW,)
    assert device.read().shape == (4, 4, 3)
    device.close()
    assert Film.made[-1].closed == 1


def test_sensor_that_is_closed_is_opened_first() -> None:
    sensor = second_camera(VIEW)
    with pytest.raises(SensorError) as caught:
        ThreadReader(sensor).latest()
    assert str(caught.value) == "sensor 'side' is closed; open it first"
