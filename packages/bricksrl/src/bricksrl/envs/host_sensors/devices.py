"""Sensors on the computer that come with BricksRL: lines of numbers from a serial port, and further cameras."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from bricksrl.envs.host_sensors.host_sensor import Device, HostSensor, World
from bricksrl.envs.vision.camera import Camera, CameraView, TwinCamera, VideoCamera
from bricksrl.envs.vision.frames import shrink
from bricksrl.errors import SensorError

_SILENCE_S = 1.0
_FRAMES_HZ = 30.0


@dataclass(frozen=True)
class SerialNumbers:
    """Opens a serial port on which a device, such as an Arduino or a micro:bit, writes lines of numbers: ``21.5, 48``; other
    lines are skipped.

    Attributes:
        port: ``"/dev/ttyACM0"``, ``"COM3"``, or an address of pyserial's such as ``"socket://phone:5000"``.
        baud: bits per second.
    """

    port: str
    baud: int = 115_200

    def __call__(self) -> Device:
        import serial

        return _SerialDevice(serial.serial_for_url(self.port, self.baud, timeout=_SILENCE_S))


class _SerialDevice:
    def __init__(self, port: Any) -> None:
        self._port = port
        self._port.readline()  # it may begin in the middle

    def read(self) -> tuple[float, ...]:
        line = ""
        for _ in range(1000):
            line = self._port.readline().decode("ascii", "replace").strip()
            try:
                numbers = tuple(map(float, filter(None, re.split(r"[,;\s]+", line))))
            except ValueError:
                continue
            if numbers:
                return numbers
            if not line:
                raise SensorError(f"{self._port.port} says nothing for {_SILENCE_S:g} s; look whether its program runs")
        raise SensorError(f"{self._port.port} writes '{line:.40}' and no lines of numbers; correct its program or the baud rate")

    def close(self) -> None:
        self._port.close()


def second_camera(view: CameraView) -> HostSensor:
    """A further camera: its image is in the observation under ``view.name``, which is the camera in a virtual robot's model."""

    def image(world: World) -> Any:
        if view.name not in world.kept:
            world.kept[view.name] = _CameraDevice(TwinCamera(world.body, view), view.image_px)
        return world.kept[view.name].read()

    def opened() -> Device:
        return _CameraDevice(VideoCamera(view), view.image_px)

    return HostSensor(view.name, (), opened, image, rate_hz=_FRAMES_HZ, image_px=view.image_px)


class _CameraDevice:
    def __init__(self, camera: Camera, image_px: int) -> None:
        self._camera, self._px = camera, image_px

    def read(self) -> Any:
        return shrink(self._camera.frame(), self._px, None)

    def close(self) -> None:
        self._camera.close()
