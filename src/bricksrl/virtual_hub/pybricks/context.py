"""Context of one program's Pybricks modules: the machine, the run loop, and how they refuse and wait."""

from __future__ import annotations

import errno
import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from bricksrl.virtual_hub.console import Console
from bricksrl.virtual_hub.firmware.trajectory import InfeasibleMoveError
from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.micropython.errors import HubOSError

_HINTS = """--> Check the line in your script that matches
    the line number given in the 'Traceback' above.

"""
_NOT_CONNECTED = (
    "\n\nA sensor or motor is not connected to the specified port:\n--> Check the cables to each motor and sensor.\n"
    "--> Check the port settings in your script.\n" + _HINTS
)
_NOT_SUPPORTED = (
    "\n\nThe requested operation is not supported on this device:\n"
    "--> Check the documentation for device compatibility.\n" + _HINTS
)
_NOT_NOW = (
    "\n\nThe requested operation is not valid in the current state:\n"
    "--> Check the documentation for required conditions.\n" + _HINTS
)
_MESSAGES = {
    errno.ENODEV: _NOT_CONNECTED,
    errno.EOPNOTSUPP: _NOT_SUPPORTED,
    errno.EPERM: _NOT_NOW,
    errno.EBUSY: "Device or resource busy",
    errno.ETIMEDOUT: "Timed out",
}


def os_error(code: int) -> HubOSError:
    """The error that the firmware raises for this number, with its text."""
    return HubOSError(code, _MESSAGES[code])


@contextmanager
def refusals() -> Iterator[None]:
    """Errors of the motor control, as the firmware words them."""
    try:
        yield
    except HubOSError:
        raise
    except InfeasibleMoveError:
        raise RuntimeError("Unknown error") from None
    except ValueError:
        raise ValueError("Invalid argument") from None
    except OSError as error:
        raise os_error(error.errno or errno.EPERM) from None


def get_int(value: Any) -> int:
    """A whole number; floats are cut off, as nearly everywhere in the firmware.

    Raises:
        TypeError: it is no number.
    """
    if type(value) is int:
        return value
    if isinstance(value, int | float):
        return int(value)
    raise TypeError(f"can't convert {type(value).__name__} to int")


def percentage(value: Any) -> int:
    """A whole number within 0..100; what is beyond becomes the nearest of them."""
    return max(0, min(100, get_int(value)))


def get_number(value: Any) -> float:
    """A number as a float.

    Raises:
        TypeError: it is none.
    """
    if not isinstance(value, int | float):
        raise TypeError(f"can't convert {type(value).__name__} to float")
    return float(value)


def get_text(value: Any) -> str:
    """A text, or the bytes of one.

    Raises:
        TypeError: it is neither.
    """
    if not isinstance(value, str | bytes):
        raise TypeError(f"can't convert '{type(value).__name__}' object to str implicitly")
    return value if isinstance(value, str) else value.decode("latin-1")


def get_array(value: Any) -> Sequence[Any]:
    """A tuple or list as it is.

    Raises:
        TypeError: it is something else.
    """
    if not isinstance(value, list | tuple):
        raise TypeError(f"object '{type(value).__name__}' isn't a tuple or list")
    return value


def get_scaled(value: Any, scale: int) -> int:
    """A number in units of 1/``scale``."""
    return int(value * scale) if isinstance(value, float) else get_int(value) * scale


def expect_type(value: Any, kind: type) -> None:
    """Raises TypeError, in the firmware's words, for a value of another class."""
    if not isinstance(value, kind):
        raise TypeError(f"can't convert {type(value).__name__} to {kind.__name__}")


class Async:
    """Awaitable that a method returns inside the run loop: done as soon as ``is_done`` says so, then it has a value."""

    __slots__ = ("_is_done", "_on_close", "_result", "_state")

    def __init__(
        self, is_done: Callable[[], bool], result: Callable[[], Any] | None, on_close: Callable[[], None] | None
    ) -> None:
        self._is_done = is_done
        self._result = result
        self._on_close = on_close
        self._state = "running"

    def __iter__(self) -> Async:
        return self

    def __next__(self) -> None:
        if self._state != "running":
            raise StopIteration
        if self._is_done():
            self._state = "done"
            raise StopIteration(self._result() if self._result is not None else None)

    def cancel(self) -> None:
        """Let whoever awaits this go on, because another command took over."""
        self._state = "cancelled"

    def close(self) -> None:
        """Give up: what was started is stopped."""
        if self._state == "running":
            self._state = "cancelled"
            if self._on_close is not None:
                self._on_close()


class RunLoop:
    """State of ``run_task``, and how methods wait inside and outside of it."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.is_active = False
        self.is_busy = False

    def turn_over(self) -> None:
        """Let the time of one turn of ``run_task`` pass: next to none where a task only let the others go first."""
        if self.is_busy:
            self.is_busy = False
            self.machine.charge_call()
        else:
            self.machine.advance(1)

    def yield_once(self) -> Async:
        """Something to await that only lets the other tasks go first."""
        looks = iter((False, True))

        def is_done() -> bool:
            done = next(looks)
            self.is_busy = self.is_busy or not done
            return done

        return Async(is_done, None, None)

    def assert_blocking(self) -> None:
        if self.is_active:
            raise RuntimeError("This can only be called before multitasking starts.")

    def finish(
        self,
        is_done: Callable[[], bool],
        result: Callable[[], Any] | None = None,
        on_close: Callable[[], None] | None = None,
        grain_ms: int = 0,
    ) -> Any:
        """Wait here and now, or return something to await.

        Args:
            grain_ms: how much time passes between two looks; 0 for the next control loop.
        """
        if self.is_active:
            return Async(is_done, result, on_close)
        while not is_done():
            if grain_ms:
                self.machine.advance(grain_ms)
            else:
                self.machine.advance_to_control()
        return result() if result is not None else None

    def wait_until(self, end_ms: int, on_close: Callable[[], None] | None = None) -> Any:
        """Wait for a time of the machine."""
        if self.is_active:
            return Async(lambda: self.machine.time_ms >= end_ms, None, on_close)
        if end_ms > self.machine.time_ms:
            self.machine.advance(end_ms - self.machine.time_ms)
        return None

    def value(self, get: Callable[[], Any]) -> Any:
        """A sensor's value: at once, or to await."""
        return Async(lambda: True, get, None) if self.is_active else get()

    def done(self) -> Any:
        """A command without an answer that is over at once."""
        return self.value(lambda: None)


class Latest:
    """The command of a device that is awaited: a new one always wins, and who awaits the old one goes on."""

    def __init__(self, loop: RunLoop) -> None:
        self._loop = loop
        self._awaited: Async | None = None

    def cancel(self) -> None:
        if self._awaited is not None:
            self._awaited.cancel()
            self._awaited = None

    def finish(
        self,
        is_done: Callable[[], bool],
        result: Callable[[], Any] | None = None,
        on_close: Callable[[], None] | None = None,
        grain_ms: int = 0,
    ) -> Any:
        """As that of the run loop, in place of the command before."""
        self.cancel()
        outcome = self._loop.finish(is_done, result, on_close, grain_ms)
        if isinstance(outcome, Async):
            self._awaited = outcome
        return outcome


class Context:
    """One program on one machine."""

    def __init__(self, machine: Machine, console: Console) -> None:
        self.machine = machine
        self.console = console
        self.loop = RunLoop(machine)


_Class = TypeVar("_Class", bound=type)


def bound(kind: _Class, context: Context) -> _Class:
    """A class of its own for one program, whose objects find the machine."""
    own = type(kind.__name__, (kind,), {"_context": context, "_loop": context.loop, "_machine": context.machine})
    own.__qualname__, own.__module__ = kind.__qualname__, kind.__module__
    return own  # type: ignore[return-value]


def charged(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method that takes no simulated time, counted."""

    @functools.wraps(method)
    def call(self: Any, *args: Any, **kwargs: Any) -> Any:
        self._machine.charge_call()
        return method(self, *args, **kwargs)

    return call
