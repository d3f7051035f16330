"""A hub without physics: motors follow commands, sensors return given values.

The program is a greenlet in simulated time with a hub's builtins only.
"""

from __future__ import annotations

import builtins
import struct
import traceback
from collections.abc import Callable
from types import CodeType, SimpleNamespace
from typing import Any

from greenlet import getcurrent, greenlet

from brickhub.errors import HubError
from brickhub.hub.transport import HubProgram


class Motor:
    """Turns at the commanded speed to its target; ``blocked`` stops it."""

    def __init__(
        self, hub: StandInHub, port: str, direction: int = 1, gears: list[int] | None = None
    ) -> None:
        if port in hub.unplugged:
            raise OSError(19, "ENODEV")
        self.hub, self.port, self.gears = hub, port, gears
        self.position, self.speed_deg_s, self.target = float(hub.start_deg.get(port, 0)), 0.0, 0.0
        self.moving = self.blocked = False
        self.stops = 0
        self.limits: dict[str, int] = {}
        self.control = SimpleNamespace(limits=lambda **limits: self.limits.update(limits))
        hub.motors[port] = self

    def angle(self) -> int:
        return round(self.position)

    def done(self) -> bool:
        return not self.moving

    def stop(self) -> None:
        self.stops += 1
        self.moving = False

    def run_angle(self, speed: int, angle: int, wait: bool = True) -> None:
        self._run("run_angle", speed, self.position + angle, angle, wait)

    def run_target(self, speed: int, target: int, wait: bool = True) -> None:
        self._run("run_target", speed, target, target, wait)

    def _run(self, name: str, speed: int, target: float, argument: int, wait: bool) -> None:
        assert isinstance(argument, int), "the firmware would cut the fraction off"
        assert not wait, "the program must not block"
        if self.port in self.hub.unplugged:
            raise OSError(19, "ENODEV")
        self.hub.moves.append((name, self.port, speed, argument))
        self.moving, self.target, self.speed_deg_s = True, target, speed

    def step_ms(self) -> None:
        if self.moving and not self.blocked:
            step = self.speed_deg_s / 1000
            left = self.target - self.position
            self.position = (
                self.target if abs(left) <= step else self.position + (step if left > 0 else -step)
            )
            self.moving = self.position != self.target


class DriveBase:
    """Moves both wheels equally, at 200 mm/s."""

    def __init__(self, left: Motor, right: Motor, wheel_diameter: float, axle_track: float) -> None:
        self.wheels = (left, right)
        self.deg_per_mm = 360 / (3.1415926 * wheel_diameter)

    def straight(self, distance: int, wait: bool = True) -> None:
        assert isinstance(distance, int) and not wait
        self.wheels[0].hub.moves.append(("straight", distance))
        for wheel in self.wheels:
            wheel.moving, wheel.speed_deg_s = True, 200 * self.deg_per_mm
            wheel.target = wheel.position + distance * self.deg_per_mm

    def done(self) -> bool:
        return all(wheel.done() for wheel in self.wheels)

    def stop(self) -> None:
        for wheel in self.wheels:
            wheel.stop()


class Poll:
    """Poll of one stream; without a mask, output readiness is reported, as in some firmware."""

    def __init__(self, hub: StandInHub) -> None:
        self.hub, self.mask = hub, 0

    def register(self, stream: Any, mask: int = 1 | 4) -> None:
        self.mask = mask

    def poll(self, timeout_ms: int) -> list[int]:
        while not (events := self.hub.stdin_events & self.mask) and timeout_ms > 0:
            self.hub.wait(1)
            timeout_ms -= 1
        return [events] if events else []


class StandInHub:
    """A transport to the stand-in; ``down`` and ``up`` may change bytes."""

    def __init__(self, stdin_bytes: int = 20) -> None:
        self.time_ms = 0
        self.motors: dict[str, Motor] = {}
        self.moves: list[tuple[Any, ...]] = []
        self.unplugged: set[str] = set()
        self.start_deg: dict[str, int] = {}
        self.tilt, self.yaw_rate_deg_s, self.distance_mm = (0.0, 0.0), 0.0, 1000
        self.down: Callable[[bytes], bytes] = lambda data: data
        self.up: Callable[[bytes], bytes] = lambda data: data
        self.writes: list[bytes] = []
        self.sent: list[bytes] = []
        self.starts = self.closes = 0
        self.interrupt_byte: int | None = None
        self._stdin_bytes = stdin_bytes
        self._stdin, self._outbox = bytearray(), bytearray()
        self._program: greenlet | None = None
        self._wake_ms = 0

    # ---- Transport

    def open(self) -> None:
        pass

    def start(self, program: HubProgram) -> None:
        self.stop()
        self.starts += 1
        self.motors.clear()
        self._stdin.clear()
        self._program = greenlet(self._run)
        self._program.switch(compile(program.source, "main.py", "exec"))

    def write(self, data: bytes) -> None:
        if not self.running:
            raise HubError("no program runs; start one")
        assert len(data) <= 20
        self.writes.append(data)
        data = self.down(data)
        if len(self._stdin) + len(data) > self._stdin_bytes:
            raise HubError("the input buffer is full; wait")
        self._stdin += data

    def read(self, timeout_s: float) -> bytes:
        deadline_ms = self.time_ms + round(timeout_s * 1000)
        while not self._outbox and self.time_ms < deadline_ms:
            if not self.running:
                self.time_ms = deadline_ms
                break
            self._wake_ms = deadline_ms
            assert self._program is not None
            self._program.parent = getcurrent()
            self._program.switch()
        data = bytes(self._outbox)
        self._outbox.clear()
        return data

    def stop(self) -> None:
        if self.running:
            assert self._program is not None
            self._program.throw(SystemExit)

    def close(self) -> None:
        self.closes += 1
        self.stop()

    def now_s(self) -> float:
        return self.time_ms / 1000

    # ---- for tests

    @property
    def running(self) -> bool:
        return self._program is not None and not self._program.dead

    def run_ms(self, duration_ms: int) -> bytes:
        """Run the program. Returns its output."""
        end_ms, data = self.time_ms + duration_ms, b""
        while self.time_ms < end_ms:
            data += self.read((end_ms - self.time_ms) / 1000)
        return data

    # ---- what the program sees

    def _run(self, code: CodeType) -> None:
        names: dict[str, Any] = dict(vars(builtins))
        names |= {
            "__import__": self._import,
            "print": lambda *words: self._emit(" ".join(map(str, words)).encode()),
        }
        try:
            # the program under test
            exec(code, {"__builtins__": names, "__name__": "__main__"})  # noqa: S102
        except SystemExit:
            self._emit(b"The program was stopped (SystemExit).\r\n")
        except Exception:  # noqa: BLE001  a hub prints it
            self._emit(traceback.format_exc().encode())

    def _import(self, name: str, *_: Any) -> Any:
        modules = {
            "micropython": SimpleNamespace(
                kbd_intr=lambda byte: setattr(self, "interrupt_byte", byte)
            ),
            "pybricks.hubs": SimpleNamespace(
                **{f"{kind}Hub": self._hub for kind in ("Prime", "Technic", "Essential", "City")}
            ),
            "pybricks.parameters": SimpleNamespace(
                Port=SimpleNamespace(**{port: port for port in "ABCDEF"}),
                Direction=SimpleNamespace(CLOCKWISE=1, COUNTERCLOCKWISE=-1),
                Axis=SimpleNamespace(Z="z"),
            ),
            "pybricks.pupdevices": SimpleNamespace(
                Motor=lambda *args, **kwargs: Motor(self, *args, **kwargs),
                UltrasonicSensor=lambda port: SimpleNamespace(distance=lambda: self.distance_mm),
            ),
            "pybricks.robotics": SimpleNamespace(DriveBase=DriveBase),
            "pybricks.tools": SimpleNamespace(StopWatch=self._stop_watch),
            "uselect": SimpleNamespace(poll=lambda: Poll(self), POLLIN=1),
            "ustruct": struct,
            "usys": SimpleNamespace(
                stdin=SimpleNamespace(buffer=SimpleNamespace(read=self._read_stdin)),
                stdout=SimpleNamespace(buffer=SimpleNamespace(write=self._write_stdout)),
            ),
        }
        return modules[name]

    def _hub(self) -> Any:
        imu = SimpleNamespace(
            tilt=lambda: self.tilt, angular_velocity=lambda axis: self.yaw_rate_deg_s
        )
        return SimpleNamespace(imu=imu)

    def _stop_watch(self) -> Any:
        start_ms = self.time_ms
        return SimpleNamespace(time=lambda: self.time_ms - start_ms)

    @property
    def stdin_events(self) -> int:
        """Standard input is always writable."""
        return 4 | bool(self._stdin)

    def _read_stdin(self, n: int) -> bytes:
        assert len(self._stdin) >= n, "the program would block"
        data = bytes(self._stdin[:n])
        del self._stdin[:n]
        return data

    def _write_stdout(self, data: bytes) -> None:
        assert len(data) <= 19, "more than one notification"
        self.sent.append(data)
        self._emit(self.up(data))

    def _emit(self, data: bytes) -> None:
        self._outbox += data

    def wait(self, duration_ms: int) -> None:
        for _ in range(duration_ms):
            for motor in self.motors.values():
                motor.step_ms()
            self.time_ms += 1
        if self._outbox or self.time_ms >= self._wake_ms:
            getcurrent().parent.switch()
