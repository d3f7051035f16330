"""Sensors on the computer that come with BricksRL: lines of numbers from a serial port, and further
cameras."""

import contextlib
import re
from collections.abc import Callable
from typing import Any

from bricksrl.envs.host_sensors.host_sensor import Device, HostSensor, World
from bricksrl.envs.vision.camera import Camera, CameraView, TwinCamera, VideoCamera
from bricksrl.envs.vision.frames import shrink
from bricksrl.errors import SensorError

_SILENCE_S = 1.5
"""Time without a line after which a device counts as silent."""
_FRAMES_HZ = 30.0
"""Rate of an ordinary webcam."""
_MOST_LINES = 1000
"""Lines to skip before what a device writes counts as no numbers."""


def serial_numbers(port: str, baud: int = 115_200) -> Callable[[], Device]:
    """Opener of a serial port on which a device, such as an Arduino or a micro:bit, writes lines of
    numbers: ``21.5, 48``. Other lines are skipped; 1.5 s without a line is a failure. ``port``:
    ``"/dev/ttyACM0"``, ``"COM3"``, or another address of pyserial's, such as
    ``"socket://192.168.1.20:5000"``."""
    return lambda: _SerialNumbers(port, baud)


class _SerialNumbers:
    def __init__(
        self,
        port: str,
        baud: int,
    ) -> None:
        import serial

        self._port = serial.serial_for_url(port, baud, timeout=_SILENCE_S)
        # The first line may begin in the middle, so it is dropped.
        self._port.readline()

    def read(self) -> tuple[float, ...]:
        """The newest line of numbers: older ones that wait are skipped."""
        numbers: tuple[float, ...] | None = None
        for _ in range(_MOST_LINES):
            line = self._port.readline().decode("ascii", "replace")
            if not line:
                raise SensorError(
                    f"{self._port.port} says nothing for {_SILENCE_S:g} s; look whether its "
                    "program runs"
                )
            with contextlib.suppress(ValueError):
                numbers = tuple(map(float, re.split(r"[,;\s]+", line.strip())))
            if numbers is not None and not self._port.in_waiting:
                return numbers
        raise SensorError(
            f"{self._port.port} writes no lines of numbers but '{line.strip():.40}'; correct "
            "program or baud rate"
        )

    def close(self) -> None:
        self._port.close()


def second_camera(view: CameraView) -> HostSensor:
    """A further camera: its image is in the observation under ``view.name``, which is the camera in
    a virtual robot's model."""

    def opened() -> Device:
        return _Images(VideoCamera(view), view.image_px)

    def in_twin(world: World) -> Any:
        # Rendering is slow, so one camera serves all readings of a robot.
        camera = _Images(TwinCamera(world.body, view), view.image_px)
        device = world.kept.setdefault(view.name, camera)
        return device.read()

    return HostSensor(
        view.name,
        (),
        opened,
        in_twin,
        rate_hz=_FRAMES_HZ,
        image_px=view.image_px,
    )


class _Images:
    def __init__(
        self,
        camera: Camera,
        image_px: int,
    ) -> None:
        self._camera = camera
        self._px = image_px

    def read(self) -> Any:
        return shrink(self._camera.frame(), self._px, None)

    def close(self) -> None:
        self._camera.close()
