"""Faults of a virtual robot, as real ones have them: to practise finding them, and to see what a
program or an agent does then.

A fault is a text such as ``reversed:left``. A kind is a row of `FAULT_KINDS`. A faulty robot is a
body around a sound one, which changes what passes between the hub and the motors and sensors; what
is described of the robot stays as it is.
"""

import copy
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from brickhub.errors import DescriptionError, hint
from brickhub.hub.link.profiles import LinkProfile
from brickhub.robot import Motor, Robot, Sense, UltrasonicSensor
from brickhub.virtual.body import Body, Rng
from brickhub.virtual.stimuli import DEFAULT_STIMULI, Sensed

_LOWEST_V = 3.0
_HIGHEST_V = 9.0
_MOST_SLIP = 0.95
"""Largest slip. It is less than 1, because the motor's angle is that of the wheel divided by the
share that is kept."""
_REFUSALS = 2
"""Calls for which a hub stays out of reach after its link broke."""
_NOTHING_SENSED: dict[Sense, Sensed] = {
    **DEFAULT_STIMULI,
    Sense.SURFACE: (0.0, 0.0, 0.0),
    Sense.FORCE: 0.0,
    Sense.TILT: (0.0, 0.0),
    Sense.ROTATION: (0.0, 0.0),
}
"""What a sensor tells that senses nothing; an ultrasonic sensor tells its farthest distance."""


@dataclass(frozen=True)
class Fault:
    """Fault of one robot.

    Attributes:
        kind: name of its row in `FAULT_KINDS`.
        device: name of the motor or sensor; empty for a fault of the whole robot.
        value: volts, seconds or the lost share; 0 for a kind without a number.
        port: letter of a port; empty for a kind without one.
    """

    kind: str
    device: str = ""
    value: float = 0.0
    port: str = ""


@dataclass(frozen=True)
class FaultKind:
    """Kind of fault.

    Attributes:
        example: as it is written; what comes after a colon is a device, after an equals sign a
            value.
        does: what it does to the robot.
        seen: what the owner sees.
        remedy: what to do about it on a real robot.
        apply: adds the fault to a faulty body, whose device has that port; raises DescriptionError
            if it does not suit the robot.
        low, high: range of its number; ``None`` without one.
        unit: letters that may follow the number.
    """

    example: str
    does: str
    seen: str
    remedy: str
    apply: Callable[["FaultyBody", Fault], None]
    low: float | None = None
    high: float | None = None
    unit: str = ""

    @property
    def name(self) -> str:
        return re.split("[:=]", self.example)[0]

    @property
    def has_device(self) -> bool:
        return ":" in self.example

    @property
    def has_value(self) -> bool:
        return "=" in self.example


def _weaken(body: "FaultyBody", fault: Fault) -> None:
    body.faulty_battery_mv = round(fault.value * 1000)


def _reverse(body: "FaultyBody", fault: Fault) -> None:
    # A fault that is given twice turns the motor the right way again.
    motor = body.motor(fault)
    body.directions[motor.port] = -body.directions.get(motor.port, 1)


def _slip(body: "FaultyBody", fault: Fault) -> None:
    motor = body.motor(fault)
    body.kept_shares[motor.port] = 1.0 - fault.value
    # The share counts from here on, so that the angle does not jump now.
    sound_port = body.sound_port(motor.port)
    body.start_mdeg[motor.port] = body.sound.angle_mdeg(sound_port)


def _kill(body: "FaultyBody", fault: Fault) -> None:
    body.dead_ports.add(body.device(fault).port)


def _unplug(body: "FaultyBody", fault: Fault) -> None:
    body.wire({body.device(fault).name: ""})


def _replug(body: "FaultyBody", fault: Fault) -> None:
    device = body.device(fault)
    if fault.port not in body.robot.hub.model.ports:
        ports = ", ".join(body.robot.hub.model.ports)
        raise DescriptionError(
            f"fault {fault.kind}:{fault.device}={fault.port}: the hub has no such port; "
            f"choose {ports}"
        )
    if fault.port == device.port:
        body.wire({})
        return
    # Two devices cannot share a port, so the one that is there takes the other's place.
    new_ports = {device.name: fault.port}
    for other in (*body.robot.motors, *body.robot.sensors):
        if other.port == fault.port:
            new_ports[other.name] = device.port
    body.wire(new_ports)


def _break_link(body: "FaultyBody", fault: Fault) -> None:
    body.link_breaks_s = fault.value


FAULT_KINDS: dict[str, FaultKind] = {
    kind.name: kind
    for kind in (
        FaultKind(
            "battery=6.2",
            "the battery has so many volts",
            "`check` warns; motors are slow and weak",
            "charge it",
            _weaken,
            _LOWEST_V,
            _HIGHEST_V,
            "vV",
        ),
        FaultKind(
            "reversed:left",
            "a motor turns the other way round",
            "the robot turns where it is to drive; `check` tells the wheel by the gyroscope",
            "`calibrate --reverse left`",
            _reverse,
        ),
        FaultKind(
            "port:left=C",
            "a device is plugged into another port, and what was there into its own",
            "`check` names the port; programs raise ENODEV",
            "plug it where `check` says",
            _replug,
        ),
        FaultKind(
            "dead:eyes",
            "a sensor always tells that there is nothing; a motor does not turn",
            "its reading never changes; the motor did not turn in `check`",
            "plug the cable in again; take another sensor or motor",
            _kill,
        ),
        FaultKind(
            "absent:eyes",
            "a device is not plugged in",
            "`check` names the port; programs raise ENODEV",
            "plug it in until it clicks",
            _unplug,
        ),
        FaultKind(
            "slip:left=0.5",
            "this share of a wheel's turn is lost between motor and floor",
            "the robot drives a curve; `check` tells the wheel by the gyroscope",
            "clean the tyre; push the wheel onto its axle",
            _slip,
            0.01,
            _MOST_SLIP,
        ),
        FaultKind(
            "link=12s",
            "the link breaks after so many seconds of the robot, and comes back when it is "
            "looked for again",
            "an episode ends with `link_lost`; a training continues",
            "bring the robot near; switch other radios off",
            _break_link,
            0.1,
            1e6,
            "s",
        ),
    )
}
"""Kinds of faults by name."""


def parse_fault(text: str) -> Fault:
    """Parse a fault such as ``battery=6.2``, ``reversed:left`` or ``port:left=C``. Raises
    DescriptionError if it is none."""
    match = re.fullmatch(r"\s*(\w+)\s*(?::\s*(\w+)\s*)?(?:=\s*(\S+)\s*)?", text)
    # A text that is no fault serves as a whole to guess what was meant.
    name = match[1].lower() if match else text
    if match is None or name not in FAULT_KINDS:
        examples = ", ".join(kind.example for kind in FAULT_KINDS.values())
        raise DescriptionError(
            f"'{text}' is no fault{hint(name, FAULT_KINDS)}; give one such as {examples}"
        )
    kind = FAULT_KINDS[name]
    device = match[2] or ""
    value = match[3] or ""
    # A fault has a device and a value exactly where the example of its kind has them.
    has_its_device = bool(device) is kind.has_device
    has_its_value = bool(value) is kind.has_value
    if not (has_its_device and has_its_value):
        raise DescriptionError(f"'{text}' is not a whole fault; write it as {kind.example}")
    if not value:
        return Fault(name, device)
    # A value without a range is a port.
    if kind.low is None or kind.high is None:
        return Fault(name, device, port=value.upper())
    number = _number(value, kind.unit)
    if number is None or not kind.low <= number <= kind.high:
        raise DescriptionError(
            f"'{text}': give a number from {kind.low:g} to {kind.high:g}, such as {kind.example}"
        )
    return Fault(name, device, number)


def _number(text: str, units: str) -> float | None:
    try:
        return float(text.rstrip(units) if units else text)
    except ValueError:
        return None


def with_faults(body: Body, faults: Sequence[str]) -> Body:
    """The body with faults, or itself without any. Raises DescriptionError if a fault does not suit
    the robot."""
    if not faults:
        return body
    faulty = FaultyBody(body)
    parsed = [parse_fault(text) for text in faults]
    # Wiring comes first, because other faults belong to a device wherever it is plugged in.
    parsed.sort(key=lambda fault: fault.kind not in ("port", "absent"))
    for fault in parsed:
        FAULT_KINDS[fault.kind].apply(faulty, fault)
    return faulty


def sound_body(body: Body | None) -> Any:
    """The body of a robot that can be seen: the one within a faulty one."""
    return body.sound if isinstance(body, FaultyBody) else body


class FaultyBody:
    """Body of a robot with faults; everything else is that of the sound body.

    Attributes:
        sound: the body itself, with the ports of the description.
        robot: the robot as it is wired.
        faulty_battery_mv: voltage of a weak battery; ``None`` for the body's.
        directions: -1 for ports of reversed motors.
        kept_shares: share of a wheel's turn that reaches the floor, by port, and ``start_mdeg``,
            the angle from which on.
        dead_ports: ports whose device does nothing.
        link_breaks_s: time of the robot at which its link breaks once; ``None`` for never.
    """

    def __init__(self, sound: Body) -> None:
        self.sound = sound
        self.robot: Robot = sound.robot
        self.faulty_battery_mv: int | None = None
        self.directions: dict[str, int] = {}
        self.kept_shares: dict[str, float] = {}
        self.start_mdeg: dict[str, int] = {}
        self.dead_ports: set[str] = set()
        self.link_breaks_s: float | None = None
        devices = (*sound.robot.motors, *sound.robot.sensors)
        self._described_ports = {device.name: device.port for device in devices}
        self._sound_ports: dict[str, str] = {}

    def __getattr__(self, name: str) -> Any:
        # A copy in the making has no sound body yet, and asking for it would never end.
        if name == "sound":
            raise AttributeError(name)
        return getattr(self.sound, name)

    def device(self, fault: Fault) -> Any:
        """The device of a fault. Raises DescriptionError if the robot does not have it, or it is
        unplugged."""
        all_devices = (*self.robot.motors, *self.robot.sensors)
        devices = {device.name: device for device in all_devices}
        if fault.device not in devices:
            known = ", ".join(devices) or "none"
            guess = hint(fault.device, devices)
            problem = f"robot '{self.robot.name}' has no '{fault.device}' plugged in{guess}"
            raise DescriptionError(f"fault {fault.kind}:{fault.device}: {problem}; choose {known}")
        return devices[fault.device]

    def motor(self, fault: Fault) -> Motor:
        """The motor of a fault. Raises DescriptionError if it is none."""
        device = self.device(fault)
        if not isinstance(device, Motor):
            motors = ", ".join(motor.name for motor in self.robot.motors) or "none"
            raise DescriptionError(
                f"fault {fault.kind}:{fault.device} is one of a motor; choose {motors}"
            )
        return device

    def wire(self, ports: dict[str, str]) -> None:
        """Plug devices, by name, into other ports; "" leaves them unplugged."""

        def plugged(devices: Sequence[Any]) -> tuple[Any, ...]:
            plugged_in = []
            for device in devices:
                new_port = ports.get(device.name, device.port)
                unplugged = ports.get(device.name) == ""
                if not unplugged:
                    plugged_in.append(replace(device, port=new_port))
            return tuple(plugged_in)

        # The copy avoids the checks of a description, which would demand all devices of its drive
        # base and its plan.
        wired = copy.copy(self.robot)
        for field in ("motors", "sensors"):
            object.__setattr__(wired, field, plugged(getattr(self.robot, field)))
        self.robot = wired
        # The sound body knows its devices by the ports of the description.
        devices = (*wired.motors, *wired.sensors)
        self._sound_ports = {device.port: self._described_ports[device.name] for device in devices}

    def sound_port(self, port: str) -> str:
        """Port in the description of the device that is on a port."""
        return self._sound_ports.get(port, port)

    @property
    def battery_mv(self) -> int:
        return self.sound.battery_mv if self.faulty_battery_mv is None else self.faulty_battery_mv

    @battery_mv.setter
    def battery_mv(self, battery_mv: int) -> None:
        self.sound.battery_mv = battery_mv

    @property
    def link(self) -> LinkProfile:
        return self.sound.link

    @link.setter
    def link(self, link: LinkProfile) -> None:
        self.sound.link = link

    def reset(self, rng: Rng) -> None:
        self.sound.reset(rng)

    def advance_to(self, time_ms: int) -> None:
        self.sound.advance_to(time_ms)

    def angle_mdeg(self, port: str) -> int:
        angle_mdeg = self.sound.angle_mdeg(self.sound_port(port))
        # The sound body's wheel turns as far as the floor sees it, but the motor and its sensor
        # turn further.
        if port in self.kept_shares:
            start_mdeg = self.start_mdeg[port]
            turned_mdeg = (angle_mdeg - start_mdeg) / self.kept_shares[port]
            angle_mdeg = start_mdeg + round(turned_mdeg)
        return angle_mdeg * self.directions.get(port, 1)

    def set_voltage(
        self,
        port: str,
        voltage_mv: int | None,
    ) -> None:
        if voltage_mv is None or port in self.dead_ports:
            self.sound.set_voltage(self.sound_port(port), None)
            return
        # A motor gets no more than the weak battery has, and a slipping wheel is slower by the
        # share that is lost.
        battery_mv = self.battery_mv
        limited_mv = max(-battery_mv, min(battery_mv, voltage_mv))
        share = self.kept_shares.get(port, 1.0)
        direction = self.directions.get(port, 1)
        sound_mv = round(limited_mv * (share * direction))
        self.sound.set_voltage(self.sound_port(port), sound_mv)

    def sensed(
        self,
        port: str,
        sense: Sense,
    ) -> Sensed:
        if port not in self.dead_ports:
            return self.sound.sensed(self.sound_port(port), sense)
        # Infrared sensors of a distance tell it in percent instead.
        farthest_mm = self._farthest_mm(port)
        if sense is Sense.DISTANCE and farthest_mm is not None:
            return float(farthest_mm)
        return _NOTHING_SENSED[sense]

    def distance_mm(self, port: str) -> int:
        if port in self.dead_ports:
            return self._farthest_mm(port) or UltrasonicSensor.FARTHEST_MM
        return self.sound.distance_mm(self.sound_port(port))

    def _farthest_mm(self, port: str) -> int | None:
        """What the sensor on a port tells where it hears no echo; ``None`` for one that measures
        no millimetres."""
        for sensor in self.robot.sensors:
            range_mm = sensor.kind.model.range_mm
            if sensor.port == port and range_mm is not None:
                return range_mm[1]
        return None

    def tilt_deg(self) -> tuple[float, float]:
        return self.sound.tilt_deg()

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return self.sound.angular_velocity_deg_s()

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return self.sound.acceleration_mm_s2()

    def heading_deg(self) -> float:
        return self.sound.heading_deg()

    def rotation_deg(self) -> tuple[float, float, float]:
        return self.sound.rotation_deg()

    def true_place(self) -> tuple[float, float, float]:
        return self.sound.true_place()


class BreakingLink:
    """Whether the hub of a faulty body is in reach: not for the first calls after its link breaks,
    until it is looked for again.

    Args:
        breaks_s: time of the robot at which that is.
        now_s: its present time.
    """

    def __init__(
        self,
        breaks_s: float,
        now_s: Callable[[], float],
    ) -> None:
        self._breaks_s = breaks_s
        self._now_s = now_s
        self._refusals = 0

    def __call__(self) -> bool:
        if self._now_s() < self._breaks_s or self._refusals >= _REFUSALS:
            return True
        self._refusals += 1
        return False
