"""Sensor on the computer: its description in a task, and what reads it beside the exchange with the
hub.

A real one is read in a thread; a step takes the newest reading and never waits. In the twin, a
function of the virtual robot's world takes its place, at the end of a step and at most as often as
the sensor's rate.
"""

from __future__ import annotations

import contextlib
import math
import reprlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from brickhub.entry import Entry
from brickhub.fields import check_arguments, check_fields
from brickhub.user_lines import line_of_user
from bricksrl.errors import DescriptionError, SensorError, message_of
from bricktwin.twin.scene import Scene

if TYPE_CHECKING:
    import numpy as np

    from bricktwin.twin.standing import Pose


_LARGEST = 3.4e38
"""Largest number of single precision, which observations have."""


class Device(Protocol):
    """An open sensor; its methods may raise anything."""

    def read(self) -> Any:
        """The next reading, for which it may wait: numbers ``[n]``, or an image uint8 ``[side,
        side, 3]``."""

    def close(self) -> None:
        """Release the device."""


@dataclass(frozen=True)
class World:
    """What a virtual sensor may sense.

    Attributes:
        pose: returns the true pose; ``None`` for a robot on the bench.
        body, scene: body of the virtual robot, and its surroundings.
        rng: source of noise, seeded with the environment.
        now_s: simulated time.
        kept: devices that a sensor makes once; closed with the robot.
    """

    pose: Callable[[], Pose] | None
    body: Any
    scene: Scene
    rng: np.random.Generator
    now_s: Callable[[], float]
    kept: dict[str, Device] = field(default_factory=dict)


@dataclass(frozen=True)
class HostSensor:
    """A sensor on the computer, such as one on a serial port. Raises DescriptionError if the
    description is inconsistent.

    Attributes:
        name: its name; that of an image in the observation.
        entries: its numbers, with nominal ranges; empty for an image.
        open: opens the real device.
        twin: its reading beside a virtual robot, with its noise; ``None`` to read the real device
            there too.
        rate_hz: readings per second at most.
        observes_age: whether the age of the reading is observed too, in seconds.
        patience_s: age of a reading at which the sensor counts as lost: the step then ends like one
            with a lost link.
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
        check_fields(HostSensor, vars(self))
        if not self.name.isidentifier() or bool(self.entries) == (self.image_px > 0):
            raise DescriptionError(
                f"sensor '{self.name}': give a name of letters and digits, and either entries or "
                "image_px"
            )
        if not (self.rate_hz > 0 and self.patience_s > 0):
            raise DescriptionError(f"sensor '{self.name}': give a rate and a patience above 0")
        check_arguments(f"open of sensor '{self.name}'", self.open, ())
        if self.twin is not None:
            check_arguments(f"twin of sensor '{self.name}'", self.twin, ("world",))

    @property
    def observed_entries(self) -> tuple[Entry, ...]:
        """Entries of the observation: its numbers, of which any are possible, and its age."""
        entries = []
        for entry in self.entries:
            limits = entry.limits or (-math.inf, math.inf)
            entries.append(replace(entry, limits=limits))
        if self.observes_age:
            entries.append(
                Entry(
                    f"{self.name}_age",
                    0.0,
                    self.patience_s,
                    "s",
                )
            )
        return tuple(entries)

    def checked(self, reading: Any) -> Any:
        """A reading: numbers as floats, or the image. Raises SensorError for another count or
        shape, or no number."""
        if self.image_px:
            if getattr(reading, "shape", None) != (self.image_px, self.image_px, 3):
                raise SensorError(
                    f"sensor '{self.name}' gives no image of {self.image_px} x {self.image_px} px "
                    "in three colors"
                )
            return reading
        values: tuple[float, ...] = ()
        # A text is refused first, because the letters of "123" would pass as numbers.
        if not isinstance(reading, str | bytes):
            with contextlib.suppress(TypeError, ValueError):
                values = tuple(map(float, reading))
        # NaN fails every comparison, so this refuses it too.
        are_numbers = all(abs(value) <= _LARGEST for value in values)
        if len(values) != len(self.entries) or not are_numbers:
            expected = ", ".join(entry.name for entry in self.entries)
            given = list(values) or reprlib.repr(reading)
            raise SensorError(
                f"sensor '{self.name}' gives {given}; let it give a number each for {expected}"
            )
        return values


class TwinReader:
    """Reads a sensor of a virtual robot."""

    def __init__(
        self,
        sensor: HostSensor,
        twin: Callable[[World], Any],
        world: World,
    ) -> None:
        self.sensor = sensor
        self._twin = twin
        self._world = world
        self._newest: Any = None
        self._read_s = -math.inf

    def open(self) -> None:
        self._read_s = -math.inf

    def latest(self) -> tuple[Any, float]:
        now_s = self._world.now_s()
        if now_s - self._read_s >= 1.0 / self.sensor.rate_hz:
            try:
                self._newest = self.sensor.checked(self._twin(self._world))
                self._read_s = now_s
            except SensorError as error:
                # This must be no lost link, because a link would be tried again.
                raise DescriptionError(f"the twin of a {error}") from None
        return self._newest, now_s - self._read_s

    def close(self) -> None:
        for device in self._world.kept.values():
            device.close()


class ThreadReader:
    """Reads a real sensor in a thread; may be opened again after it was closed."""

    def __init__(self, sensor: HostSensor) -> None:
        self.sensor = sensor
        self._thread: threading.Thread | None = None
        self._newest: Any = None
        self._read_s = -math.inf
        self._error = SensorError(f"sensor '{sensor.name}' is closed; open it first")
        self._is_over = threading.Event()
        self._is_over.set()

    def open(self) -> None:
        """Open the sensor, and wait for its first reading. Raises SensorError if none comes;
        without effect while it is open."""
        if not self._is_over.is_set():
            return
        self._is_over = threading.Event()
        has_come = threading.Event()
        self._read_s = -math.inf
        arguments = (self._is_over, has_come, self._thread)
        self._thread = threading.Thread(
            target=self._run,
            args=arguments,
            name=f"sensor {self.sensor.name}",
            daemon=True,
        )
        self._thread.start()
        has_come.wait(self.sensor.patience_s)
        self.latest()

    def latest(self) -> tuple[Any, float]:
        """The newest reading and its age in seconds, at once. Raises SensorError if the sensor
        failed or is silent."""
        age_s = time.perf_counter() - self._read_s
        if self._is_over.is_set():
            raise self._error
        if age_s > self.sensor.patience_s:
            self.close()
            raise SensorError(
                f"sensor '{self.sensor.name}' gave no reading for {self.sensor.patience_s:g} s; "
                "look at its cable"
            )
        return self._newest, age_s

    def close(self) -> None:
        """End the thread after its present reading, without waiting for it."""
        self._is_over.set()

    def _run(
        self,
        is_over: threading.Event,
        has_come: threading.Event,
        before: threading.Thread | None,
    ) -> None:
        if before is not None:
            # The thread before still holds the device.
            before.join()
        try:
            device = self.sensor.open()
            try:
                while not is_over.is_set():
                    started_s = time.perf_counter()
                    self._newest = self.sensor.checked(device.read())
                    self._read_s = time.perf_counter()
                    has_come.set()
                    next_s = started_s + 1.0 / self.sensor.rate_hz
                    is_over.wait(max(0.0, next_s - time.perf_counter()))
            finally:
                device.close()
        except SensorError as error:
            self._error = error
        except BaseException as error:  # noqa: BLE001 - a device of the user's may raise anything
            what = f"{message_of(error, typed=True)}{line_of_user(error)}"
            self._error = SensorError(
                f"sensor '{self.sensor.name}' failed ({what}); plug it in, or correct it"
            )
        is_over.set()
        has_come.set()


Reader = TwinReader | ThreadReader


def reader_of(sensor: HostSensor, world: World | None) -> Reader:
    """The reader of a sensor, beside a virtual robot if there is a world."""
    if sensor.twin is None or world is None:
        return ThreadReader(sensor)
    return TwinReader(sensor, sensor.twin, world)
