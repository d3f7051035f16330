"""Motor of the bench, in steps of 1 ms with the states angle, speed and current.

That of SPIKE is the model of the firmware's test build (``motor_driver_virtual_simulation.c``, v4):
a medium angular motor, used for every kind of Powered Up. Motors of EV3 have their own, by the
constants from which Pybricks computes its observers (``pbio/doc/control/motor_data.py``), never by
those observers: the firmware runs them at twice the rate that they are made for.
"""

from dataclasses import dataclass
from math import pi

from brickhub.robot import MotorKind

_FRICTION_LINEAR_BELOW_MDEG_S = 2000.0
_STOP_UNM_PER_MDEG = 500.0
_STOP_UNM_PER_MDEG_S = 5.0
_STEP_S = 0.001
_SERIES_TERMS = 30
"""Terms of the exponential series: a step is short, so that it converges."""
# A motor counts in these units; its constants are in those of physics.
_MDEG_PER_RAD = 180_000.0 / pi
_UNITS_PER_A = 10_000.0
_V_PER_MV = 1e-3
_NM_PER_UNM = 1e-6

Row = tuple[float, ...]


@dataclass(frozen=True)
class Step:
    """What a step of 1 ms makes of speed, current, voltage and torque against the motion.

    Attributes:
        angle: change of the angle by each of the four.
        speed, current: the next speed and current, likewise.
        friction_unm: dry friction.
    """

    angle: Row
    speed: Row
    current: Row
    friction_unm: float


@dataclass(frozen=True)
class Constants:
    """Constants of a motor with its gears, at the shaft.

    Attributes:
        torque_nm_a: torque per current.
        emf_v_s: voltage per speed (rad/s).
        resistance_ohm, inductance_h: of the winding.
        inertia_kg_m2: of the rotor, through the gears.
        friction_unm: dry friction.
    """

    torque_nm_a: float
    emf_v_s: float
    resistance_ohm: float
    inductance_h: float
    inertia_kg_m2: float
    friction_unm: float

    def step(self) -> Step:
        """The exact solution over a step, in which voltage and torque are constant."""
        # Derivatives of angle, speed and current (rows) by angle, speed, current, voltage and
        # torque (columns), in the motor's own units. The last two rows are 0: the inputs stay.
        per_torque = _MDEG_PER_RAD / self.inertia_kg_m2
        per_voltage = _UNITS_PER_A / self.inductance_h
        rates = [[0.0] * 5 for _ in range(5)]
        rates[0][1] = 1.0
        rates[1][2] = self.torque_nm_a / _UNITS_PER_A * per_torque
        rates[1][4] = -_NM_PER_UNM * per_torque
        rates[2][1] = -self.emf_v_s / _MDEG_PER_RAD * per_voltage
        rates[2][2] = -self.resistance_ohm / self.inductance_h
        rates[2][3] = _V_PER_MV * per_voltage
        angle, speed, current, _, _ = _exponential(rates, _STEP_S)
        return Step(tuple(angle[1:]), tuple(speed[1:]), tuple(current[1:]), self.friction_unm)


def _exponential(rates: list[list[float]], time_s: float) -> list[list[float]]:
    """The matrix exponential of ``rates`` [n, n] times a time."""
    indices = range(len(rates))
    term = [[float(row == column) for column in indices] for row in indices]
    total = term
    for order in range(1, _SERIES_TERMS):
        product = [
            [sum(term[row][k] * rates[k][column] for k in indices) for column in indices]
            for row in indices
        ]
        term = [[value * time_s / order for value in row] for row in product]
        total = [
            [a + b for a, b in zip(*rows, strict=True)] for rows in zip(total, term, strict=True)
        ]
    return total


_SPIKE_MEDIUM = Step(
    angle=(
        0.0009981527613056019,
        0.001957577848006867,
        0.0002818172865566039,
        -9.498678309037282e-05,
    ),
    speed=(0.994653578576391, 3.640640918794361, 0.815657436669528, -0.18980175337809),
    current=(
        -0.0021977502690683696,
        0.6348769647439378,
        0.335291816502189,
        0.0002247101788128779,
    ),
    friction_unm=21413.268,
)
CONSTANTS = {
    MotorKind.EV3_LARGE: Constants(
        torque_nm_a=0.2746,
        emf_v_s=0.4731,
        resistance_ohm=5.505,
        inductance_h=0.015,
        inertia_kg_m2=2.478e-3,
        friction_unm=16476.0,
    ),
    MotorKind.EV3_MEDIUM: Constants(
        torque_nm_a=0.2459,
        emf_v_s=0.2912,
        resistance_ohm=10.73,
        inductance_h=0.024,
        inertia_kg_m2=5.206e-4,
        friction_unm=24593.0,
    ),
    # The firmware takes it for a large one, but it is none.
    MotorKind.NXT: Constants(
        torque_nm_a=0.3408,
        emf_v_s=0.4870,
        resistance_ohm=5.516,
        inductance_h=0.015,
        inertia_kg_m2=3.069e-3,
        friction_unm=20449.0,
    ),
}
"""Constants by kind of motor, of those whose observer in the firmware is no model of them."""
_STEPS = {kind: constants.step() for kind, constants in CONSTANTS.items()}


def step_of(kind: MotorKind) -> Step:
    """What a step makes of a kind of motor on the bench."""
    return _STEPS.get(kind, _SPIKE_MEDIUM)


class BenchMotor:
    """Motor: angle in mdeg, speed in mdeg/s, current in 0.1 mA, voltage in mV, end ``stops`` and
    start in mdeg."""

    __slots__ = ("_friction_unm", "_steps", "angle", "current", "speed", "stops", "voltage")

    def __init__(
        self,
        step: Step,
        stops: tuple[float, float] | None = None,
        start_mdeg: float = 0.0,
    ) -> None:
        self.angle = start_mdeg
        self.speed = 0.0
        self.current = 0.0
        self.voltage = 0.0
        self.stops = stops
        # All entries are unpacked at once, as this runs for each motor in each millisecond.
        self._steps = (*step.angle, *step.speed, *step.current)
        self._friction_unm = step.friction_unm

    def step(self, friction_scale: float) -> None:
        """One millisecond."""
        v = self.speed
        i = self.current
        u = self.voltage
        friction_unm = self._friction_unm * friction_scale
        linear_below = _FRICTION_LINEAR_BELOW_MDEG_S
        if v > linear_below:
            torque = friction_unm
        elif v < -linear_below:
            torque = -friction_unm
        else:
            torque = friction_unm * v / linear_below
        # An end stop is a spring with a damper, which acts only beyond it.
        if self.stops is not None:
            low, high = self.stops
            excess = self.angle - max(low, min(self.angle, high))
            if excess:
                torque += excess * _STOP_UNM_PER_MDEG + v * _STOP_UNM_PER_MDEG_S
        # This is x(k+1) = A x(k) + B u(k) of the firmware's simulation. Its order of operations is
        # kept, because it decides the last digit of a drive base's angle.
        av, ai, au, at, sv, si, su, st, cv, ci, cu, ct = self._steps
        angle = self.angle + v * av + i * ai
        self.angle = angle + u * au + torque * at
        self.speed = v * sv + i * si + u * su + torque * st
        self.current = v * cv + i * ci + u * cu + torque * ct
