"""Sensor on the computer: its description in a task, and what reads it beside the exchange with the hub.

A real one is read in a thread, as fast as its rate says; a step takes the newest reading and never waits. In the twin, a function
of the virtual robot's world takes its place, at the end of a step and at most as often as its rate.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from brickhub.entry import Entry
from brickhub.fields import check_fields
from bricksrl.errors import DescriptionError, SensorError, message_of
from bricktwin.twin.scene import Scene

if TYPE_CHECKING:
    import numpy as np

    from bricktwin.twin.mujoco_body import Pose


class Device(Protocol):
    """An open sensor."""

    def read(self) -> Any:
        """The next reading: numbers ``[n]``, or an image uint8 ``[side, side, 3]``. May wait, and raise anything."""

    def close(self) -> None:
        """Release the device."""


@dataclass(frozen=True)
class World:
    """What a virtual sensor may sense.

    Attributes:
        body: body of the virtual robot; ``scene``: its surroundings.
        rng: source of noise, seeded with the environment.
        now_s: simulated time.
        kept: devices that a sensor makes once, and closes with the robot.
    """

    body: Any
    scene: Scene
    rng: np.random.Generator
    now_s: Callable[[], float]
    kept: dict[str, Device] = field(default_factory=dict)

    @property
    def pose(self) -> Pose:
        """The true pose. Raises SensorError for a robot on the bench, which has none."""
        if not hasattr(self.body, "pose"):
            raise SensorError("the virtual robot lies on the bench and has no pose; describe a drive base, a plan or a model")
        pose: Pose = self.body.pose()
        return pose


@dataclass(frozen=True)
class HostSensor:
    """A sensor on the computer, such as one on a serial port. Raises DescriptionError if the description is inconsistent.

    Attributes:
        name: its name; that of an image in the observation.
        entries: its numbers, with nominal ranges; empty for an image.
        open: opens the real device; may raise anything.
        twin: its numbers beside a virtual robot, with their noise; ``None`` to read the real one there too.
        rate_hz: readings per second at most.
        observes_age: whether the age of the reading is observed too, in seconds, up to ``patience_s``.
        patience_s: age of a reading at which the sensor counts as lost: the step then ends like one with a lost link.
        image_px: side of its square image; 0 for numbers.
    """

    name: str
    entries: tuple[Entry, ...]
    open: Callable[[], Device]
    twin: Callable[[World], Any] | None = None
    rate_hz: float = 50.0
    observes_age: bool = False
    patience_s: float = 5.0
    image_px: int = 0

    def __post_init__(self) -> None:
        check_fields(HostSensor, vars(self), **{"World": World, "Device": Device})
        if not self.name.isidentifier() or bool(self.entries) == bool(self.image_px):
            raise DescriptionError(f"sensor '{self.name}': give a name of letters and digits, and either entries or image_px")
        if not (0 < self.rate_hz < math.inf and 0 < self.patience_s < math.inf and self.image_px >= 0):
            raise DescriptionError(f"sensor '{self.name}': give a rate and a patience above 0")

    @property
    def observed_entries(self) -> tuple[Entry, ...]:
        """Entries of the observation: its numbers, of which any are possible, and its age."""
        age = (Entry(f"{self.name}_age", 0.0, self.patience_s, "s"),) if self.observes_age else ()
        return (*(replace(entry, limits=entry.limits or (-math.inf, math.inf)) for entry in self.entries), *age)

    def checked(self, reading: Any) -> Any:
        """A reading: numbers as floats, or the image. Raises SensorError for another count or shape, or no number."""
        if self.image_px:
            if getattr(reading, "shape", None) != (self.image_px, self.image_px, 3):
                raise SensorError(f"sensor '{self.name}' gives no image of {self.image_px} x {self.image_px} px in three colors")
            return reading
        values = tuple(map(float, reading))
        if len(values) != len(self.entries) or not all(map(math.isfinite, values)):
            expected = ", ".join(entry.name for entry in self.entries)
            raise SensorError(f"sensor '{self.name}' gives {list(values)}; let it give a number each for {expected}")
        return values

    def reader(self, world: World | None) -> Reader:
        """What reads it, beside a virtual robot if there is a world."""
        if self.twin is None or world is None:
            return ThreadReader(self)
        return TwinReader(self, world)


class Reader(Protocol):
    """Reads a sensor; may be opened again after it was closed."""

    sensor: HostSensor

    def open(self) -> None:
        """Open the sensor, and wait for its first reading. Raises SensorError if none comes; without effect while it is open."""

    def latest(self) -> tuple[Any, float]:
        """The newest reading and its age in seconds, at once. Raises SensorError if the sensor failed or is silent."""

    def close(self) -> None:
        """Release the sensor, without waiting for it."""


class TwinReader:
    """Reads a sensor of a virtual robot."""

    def __init__(self, sensor: HostSensor, world: World) -> None:
        self.sensor, self._world = sensor, world
        self._newest: tuple[Any, float] | None = None

    def open(self) -> None:
        self._newest = None

    def latest(self) -> tuple[Any, float]:
        now_s = self._world.now_s()
        if self._newest is None or now_s - self._newest[1] >= 1.0 / self.sensor.rate_hz:
            assert self.sensor.twin is not None  # noqa: S101 - chosen by HostSensor.reader
            self._newest = self.sensor.checked(self.sensor.twin(self._world)), now_s
        return self._newest[0], now_s - self._newest[1]

    def close(self) -> None:
        for device in self._world.kept.values():
            device.close()


class _Session:
    """One thread from the opening of a device to its end, and what it has read."""

    def __init__(self, sensor: HostSensor, before: _Session | None) -> None:
        self.newest: tuple[Any, float] | None = None
        self.error: SensorError | None = None
        self.has_read, self.is_ended = threading.Event(), threading.Event()
        self._sensor = sensor
        self._thread = threading.Thread(target=self._run, args=(before,), name=f"sensor {sensor.name}", daemon=True)
        self._thread.start()

    def _run(self, before: _Session | None) -> None:
        if before is not None:
            before._thread.join()  # it holds the device
        try:
            device = self._sensor.open()
            try:
                while not self.is_ended.is_set():
                    started_s = time.monotonic()
                    self.newest = self._sensor.checked(device.read()), time.monotonic()
                    self.has_read.set()
                    self.is_ended.wait(max(0.0, started_s + 1.0 / self._sensor.rate_hz - time.monotonic()))
            finally:
                device.close()
        except SensorError as error:
            self.error = error
        except Exception as error:  # noqa: BLE001 - a device of the user's may raise anything
            self.error = SensorError(f"sensor '{self._sensor.name}' failed ({type(error).__name__}: {message_of(error)}); plug it in")
        self.has_read.set()


class ThreadReader:
    """Reads a real sensor in a thread."""

    def __init__(self, sensor: HostSensor) -> None:
        self.sensor = sensor
        self._session: _Session | None = None
        self._is_open = False

    def open(self) -> None:
        if self._is_open:
            return
        self._session, self._is_open = _Session(self.sensor, self._session), True
        if not self._session.has_read.wait(self.sensor.patience_s):
            self.close()
            raise self._silent()
        self.latest()

    def latest(self) -> tuple[Any, float]:
        session = self._session
        if session is None or session.error is not None:
            raise SensorError(f"sensor '{self.sensor.name}' is closed") if session is None else session.error
        if session.newest is None or time.monotonic() - session.newest[1] > self.sensor.patience_s:
            raise self._silent()
        return session.newest[0], time.monotonic() - session.newest[1]

    def _silent(self) -> SensorError:
        return SensorError(f"sensor '{self.sensor.name}' gave no reading for {self.sensor.patience_s:g} s; look at its cable")

    def close(self) -> None:
        self._is_open = False
        if self._session is not None:
            self._session.is_ended.set()
