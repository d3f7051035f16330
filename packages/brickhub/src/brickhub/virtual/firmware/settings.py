"""Settings of a controller, stored in control units, read and set in the program's units (deg or
mm)."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import trunc

from brickhub.virtual.firmware import RefusedError
from brickhub.virtual.firmware.angle import split, to_unit
from brickhub.virtual.firmware.trajectory import INT32_MAX, validate_acceleration, validate_speed

MAX_TORQUE_UNM = 1_000_000
"""Largest torque of the firmware's models, and of a limit (``pbio/doc/control/model.py``)."""


@dataclass(slots=True)
class ControlSettings:
    """Limits, gains and tolerances; ``steps_per_unit`` control steps (mdeg) make one unit of the
    program.

    Attributes:
        saturation_error: position error at which the proportional part alone saturates.
        max_integral: integral at which the integral part alone saturates.
    """

    steps_per_unit: int
    max_speed: int
    default_speed: int
    acceleration: int
    deceleration: int
    max_torque: int
    kp: int
    ki: int
    kd: int
    kp_low_pct: int
    kp_low_error: int
    kp_low_speed: int
    integral_deadzone: int
    integral_rate: int
    speed_tolerance: int
    position_tolerance: int
    stall_speed: int
    stall_time: int
    smart_hold_time: int
    saturation_error: int = field(init=False)
    max_integral: int = field(init=False)

    def __post_init__(self) -> None:
        self.saturation_error = divide_by_gain(self.max_torque, self.kp)
        self.max_integral = divide_by_gain(self.max_torque, self.ki)

    def to_unit(self, value: int) -> int:
        """A speed or a small angle in the program's units, truncated."""
        return trunc(value / self.steps_per_unit)

    def position_to_unit(self, position: int) -> int:
        """A position in the program's units: whole turns truncated, the rest rounded, as in the
        firmware."""
        return to_unit(split(position), self.steps_per_unit)

    def from_unit(self, value: int) -> int:
        """A speed or a small angle in control units, saturated to 32 bits."""
        return max(-INT32_MAX, min(INT32_MAX, value * self.steps_per_unit))

    def limits(self) -> tuple[int, int, int, int]:
        """Speed, acceleration and deceleration in the program's units, torque in mNm."""
        return (
            self.to_unit(self.max_speed),
            self.to_unit(self.acceleration),
            self.to_unit(self.deceleration),
            self.max_torque // 1000,
        )

    def set_limits(
        self,
        speed: int,
        acceleration: int,
        deceleration: int,
        torque_mnm: int,
    ) -> None:
        """Set what :meth:`limits` returns. Raises ValueError for a value out of range; if only the
        torque is, the others are set."""
        validate_speed(self.steps_per_unit, speed)
        validate_acceleration(self.steps_per_unit, acceleration)
        validate_acceleration(self.steps_per_unit, deceleration)
        self.max_speed = self.from_unit(speed)
        self.acceleration = self.from_unit(acceleration)
        self.deceleration = self.from_unit(deceleration)
        # The torque comes last, as in the firmware: a program whose torque is refused keeps the
        # other settings.
        if not 1 <= torque_mnm <= MAX_TORQUE_UNM // 1000:
            raise RefusedError("the torque limit is out of range")
        self.max_torque = torque_mnm * 1000
        # The errors at which the controller saturates depend on the torque.
        self.__post_init__()

    def group(self, name: str) -> tuple[int, ...]:
        """Settings of one of ``_GROUPS``, as a program sees them: gains in control units, times in
        ms."""
        values = []
        for setting, kind in _GROUPS[name].items():
            control_value = getattr(self, setting)
            values.append(trunc(control_value / self._steps(kind)))
        return tuple(values)

    def set_group(
        self,
        name: str,
        values: Iterable[int],
    ) -> None:
        """Set what :meth:`group` returns. Raises ValueError for a value out of range."""
        kinds = _GROUPS[name]
        new_values = dict(zip(kinds, values, strict=True))
        # Everything is checked before anything is set, so that a refusal changes nothing.
        for setting, value in new_values.items():
            kind = kinds[setting]
            high = INT32_MAX // self._steps(kind)
            if kind == "speed":
                validate_speed(self.steps_per_unit, value)
            elif kind in ("gain", "position") and not 0 <= value <= high:
                raise RefusedError(f"the {kind} is out of range")
        for setting, value in new_values.items():
            kind = kinds[setting]
            if kind in ("speed", "position"):
                setattr(self, setting, self.from_unit(value))
            else:
                setattr(self, setting, value * self._steps(kind))
        # The errors at which the controller saturates depend on the gains.
        self.__post_init__()

    def _steps(self, kind: str) -> int:
        """Control units of one unit of a program."""
        if kind == "gain":
            return 1
        # Programs give ms, but times here are in ticks of 0.1 ms.
        if kind == "time":
            return 10
        return self.steps_per_unit


_GROUPS = {
    "pid": {
        "kp": "gain",
        "ki": "gain",
        "kd": "gain",
        "integral_deadzone": "position",
        "integral_rate": "speed",
    },
    "target_tolerances": {"speed_tolerance": "speed", "position_tolerance": "position"},
    "stall_tolerances": {"stall_speed": "speed", "stall_time": "time"},
}
"""Settings that a program gets and sets together, and their kinds."""


def divide_by_gain(torque: int, gain: int) -> int:
    """Value (mdeg) for which a gain (uNm per degree) gives a torque (uNm); 0 for a gain of 0."""
    return trunc(torque * 1000 / gain) if gain > 0 else 0


def drive_base_settings(
    left: ControlSettings, right: ControlSettings
) -> tuple[ControlSettings, ControlSettings]:
    """Settings of the distance and the heading controller, by the weaker motor; the caller sets
    ``steps_per_unit``."""

    def of_both(choose: Callable[[int, int], int], *names: str) -> dict[str, int]:
        return {name: choose(getattr(left, name), getattr(right, name)) for name in names}

    # The pair gets what both motors can do: the lower limits and gains, the wider dead zone and the
    # longer hold.
    weaker = of_both(
        min,
        "max_speed",
        "kd",
        "integral_rate",
        "speed_tolerance",
        "stall_speed",
        "stall_time",
    )
    weaker |= of_both(max, "integral_deadzone", "smart_hold_time")
    # The lower gain of both keeps either motor from being controlled too harshly, so the reduced
    # gain holds for all errors.
    kp = min(left.kp, right.kp)
    kp = kp * min(left.kp_low_pct, right.kp_low_pct) // 100
    max_torque = min(left.max_torque, right.max_torque)

    def settings(default_speed: int, torque: int) -> ControlSettings:
        return ControlSettings(
            **weaker,
            steps_per_unit=1,
            default_speed=default_speed,
            acceleration=min(left.acceleration, right.acceleration) * 3 // 4,
            deceleration=min(left.deceleration, right.deceleration) * 3 // 4,
            max_torque=torque,
            kp=kp,
            ki=0,
            kp_low_pct=0,
            kp_low_error=0,
            kp_low_speed=0,
            position_tolerance=divide_by_gain(max_torque, kp),
        )

    # The default speed is 40 % of the maximum ahead, and 33 % in turns. The heading gets twice the
    # torque, so that it wins when it is saturated.
    max_speed = weaker["max_speed"]
    distance = settings(max_speed * 10 // 25, max_torque)
    heading = settings(max_speed // 3, max_torque * 2)
    return distance, heading
