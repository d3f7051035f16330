"""Motor control of a Pybricks hub: trajectories, PID with anti-windup, state observer and drive
base.

Written from the behaviour of the firmware's control library (pbio, Pybricks v4), with the same
integer units and truncations: rounding decides at which 5 ms tick a move ends. Internal units:
position mdeg, speed mdeg/s, acceleration mdeg/s2, torque uNm, voltage mV, time in ticks of 0.1 ms.
``trunc(a / b)`` is C's division, exact below 2**53 and faster than ``int(a / b)``.
"""


class RefusedError(ValueError):
    """A value that the firmware refuses."""


class UnavailableError(OSError):
    """A motor that cannot be used now (EBUSY, ENODEV), or not so (EOPNOTSUPP)."""


class InfeasibleMoveError(ArithmeticError):
    """Rounding put the phases of a move out of order; the firmware refuses the command."""


FIRMWARE_ERRORS = (RefusedError, UnavailableError, InfeasibleMoveError)
