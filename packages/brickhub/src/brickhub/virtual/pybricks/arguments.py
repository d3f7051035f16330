"""Arguments of a program's calls, checked and converted as by the firmware, and its errors."""

from collections.abc import Sequence
from typing import Any

from brickhub.virtual import error_numbers
from brickhub.virtual.micropython.exceptions import HubOSError

_INT_MIN = -(2**31)
_INT_MAX = 2**31 - 1
_HINTS = """--> Check the line in your script that matches
    the line number given in the 'Traceback' above.

"""
_NOT_CONNECTED = "A sensor or motor is not connected to the specified port"


def _explained(problem: str, *checks: str) -> str:
    lines = [f"--> Check {check}.\n" for check in checks]
    return f"\n\n{problem}:\n" + "".join(lines) + _HINTS


_MESSAGES = {
    error_numbers.ENODEV: _explained(
        _NOT_CONNECTED, "the cables to each motor and sensor", "the port settings in your script"
    ),
    error_numbers.EOPNOTSUPP: _explained(
        "The requested operation is not supported on this device",
        "the documentation for device compatibility",
    ),
    error_numbers.EPERM: _explained(
        "The requested operation is not valid in the current state",
        "the documentation for required conditions",
    ),
    error_numbers.EIO: (
        "\n\nUnexpected hardware input/output error with a motor or sensor:\n"
        "--> Try unplugging the sensor or motor and plug it back in again.\n"
        "--> To see which sensor or motor is causing the problem,\n"
        "    check the line in your script that matches\n"
        "    the line number given in the 'Traceback' above.\n"
        "--> Try rebooting the hub/brick if the problem persists.\n\n"
    ),
    error_numbers.EAGAIN: "Try again later",
    error_numbers.EBUSY: "Device or resource busy",
    error_numbers.ETIMEDOUT: "Timed out",
}


def os_error(code: int) -> HubOSError:
    """The firmware's error for a number, with its text."""
    return HubOSError(code, _MESSAGES[code])


def get_int(value: Any) -> int:
    """An integer; floats are :func:`truncated`, as mostly in the firmware. Raises TypeError if it
    is not a number."""
    # Plain integers come first, because nearly all arguments are.
    if type(value) is int:
        return value
    if isinstance(value, int | float):
        return truncated(value)
    raise TypeError(f"can't convert {type(value).__name__} to int")


def truncated(value: float) -> int:
    """A number towards zero, as a hub's processor converts it: clamped to 32 bits, also infinity; 0
    if it is not a number."""
    # Only a NaN differs from itself.
    if value != value:
        return 0
    return int(max(_INT_MIN, min(_INT_MAX, value)))


def get_exact_int(value: Any) -> int:
    """An integer (``mp_obj_get_int``). Raises TypeError for anything else, floats included."""
    if not isinstance(value, int):
        raise TypeError(f"can't convert {type(value).__name__} to int")
    return int(value)


def percentage(value: Any) -> int:
    """An integer, clamped to 0..100."""
    return max(0, min(100, get_int(value)))


def get_number(value: Any) -> float:
    """A float. Raises TypeError if it is not a number."""
    if not isinstance(value, int | float):
        raise TypeError(f"can't convert {type(value).__name__} to float")
    return float(value)


def get_text(value: Any) -> str:
    """Text, or bytes as text. Raises TypeError if it is neither."""
    if not isinstance(value, str | bytes):
        raise TypeError(f"can't convert '{type(value).__name__}' object to str implicitly")
    # A hub does not look at the encoding: each byte is a character here, and none is refused.
    return value if isinstance(value, str) else value.decode("latin-1")


def get_array(value: Any) -> Sequence[Any]:
    """A tuple or list, unchanged. Raises TypeError if it is neither."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"object '{type(value).__name__}' isn't a tuple or list")
    return value


def get_scaled(value: Any, scale: int) -> int:
    """A number in units of 1/``scale``."""
    # A float is scaled before it is truncated, so that 55.5 mm keep their half.
    if isinstance(value, float):
        return truncated(value * scale)
    return get_int(value) * scale


def expect(condition: object) -> None:
    """Raise the firmware's ValueError unless a condition holds."""
    if not condition:
        raise ValueError("Invalid argument")


def expect_type(value: Any, kind: type) -> None:
    """Raise the firmware's TypeError for a value of another class."""
    if not isinstance(value, kind):
        raise TypeError(f"can't convert {type(value).__name__} to {kind.__name__}")
