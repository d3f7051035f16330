"""Context of a program's Pybricks modules: machine, run loop, argument checks."""

from __future__ import annotations

import errno
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from types import FunctionType
from typing import Any

from brickhub.virtual.firmware.trajectory import FIRMWARE_ERRORS, RefusedError, UnavailableError
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.exceptions import HubOSError, is_native
from brickhub.virtual.micropython.streams import Console

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
_INVALID_STATE = (
    "\n\nThe requested operation is not valid in the current state:\n"
    "--> Check the documentation for required conditions.\n" + _HINTS
)
_MESSAGES = {
    errno.ENODEV: _NOT_CONNECTED,
    errno.EOPNOTSUPP: _NOT_SUPPORTED,
    errno.EPERM: _INVALID_STATE,
    errno.EBUSY: "Device or resource busy",
    errno.ETIMEDOUT: "Timed out",
}


def os_error(code: int) -> HubOSError:
    """The firmware's error for a number, with its text."""
    return HubOSError(code, _MESSAGES[code])


@contextmanager
def firmware_errors() -> Iterator[None]:
    """Convert errors of the motor control to the firmware's."""
    try:
        yield
    except FIRMWARE_ERRORS as error:
        raise _of_hub(error) from None


def _of_hub(error: Exception) -> Exception:
    """The firmware's error for one of the motor control."""
    if isinstance(error, UnavailableError):
        return os_error(error.errno or errno.EPERM)
    return ValueError("Invalid argument") if isinstance(error, RefusedError) else RuntimeError("Unknown error")


def get_int(value: Any) -> int:
    """An integer; floats are truncated, as mostly in the firmware. Raises TypeError if it is not a number."""
    if type(value) is int:
        return value
    if isinstance(value, int | float):
        if value != value:
            raise ValueError("Invalid argument")
        return int(value)
    raise TypeError(f"can't convert {type(value).__name__} to int")


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
    return value if isinstance(value, str) else value.decode("latin-1")


def get_array(value: Any) -> Sequence[Any]:
    """A tuple or list, unchanged. Raises TypeError if it is neither."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"object '{type(value).__name__}' isn't a tuple or list")
    return value


def get_scaled(value: Any, scale: int) -> int:
    """A number in units of 1/``scale``."""
    return int(value * scale) if isinstance(value, float) else get_int(value) * scale


def expect_type(value: Any, kind: type) -> None:
    """Raise the firmware's TypeError for a value of another class."""
    if not isinstance(value, kind):
        raise TypeError(f"can't convert {type(value).__name__} to {kind.__name__}")


class Async:
    """Awaitable of a method in the run loop; completes with a value when ``is_done``."""

    __slots__ = ("_is_done", "_loop", "_on_close", "_result", "_state")

    _NEW, _RUNNING, _CANCELLED, _DONE = range(4)

    def __init__(
        self,
        loop: RunLoop,
        is_done: Callable[[], bool],
        result: Callable[[], Any] | None = None,
        on_close: Callable[[], None] | None = None,
    ) -> None:
        self._loop = loop
        self._is_done = is_done
        self._result = result
        self._on_close = on_close
        self._state = self._NEW

    def __iter__(self) -> Async:
        return self

    def __next__(self) -> None:
        if self._state > self._RUNNING:
            raise StopIteration
        self._loop.is_waiting = self._state == self._RUNNING
        self._state = self._RUNNING
        if self._is_done():
            self._loop.is_waiting = False
            self._state = self._DONE
            raise StopIteration(self._result() if self._result is not None else None)

    def _cancel(self) -> None:
        """Complete early, as another command replaced this one."""
        self._state = self._CANCELLED

    def close(self) -> None:
        """Abort: stop what was started."""
        if self._state <= self._RUNNING:
            self._state = self._CANCELLED
            if self._on_close is not None:
                self._on_close()


class RunLoop:
    """State of ``run_task``, and waiting inside and outside of it.

    Attributes:
        is_active: whether tasks run.
        is_waiting: whether the task that has just yielded has been waiting since its last turn. Otherwise it only lets others
            run, or has done something for which others may wait.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.is_active = False
        self.is_waiting = False

    def advance_turn(self) -> None:
        """Advance one turn of ``run_task``; almost nothing if a task only yielded."""
        if self.is_waiting:
            self.machine.advance(1)
        else:
            self.machine.charge_call()
        self.is_waiting = False
        self.machine.branch(None)

    def yield_once(self) -> Async:
        """An awaitable that only yields to other tasks."""
        checks = iter((False, True))

        def is_done() -> bool:
            done = next(checks)
            self.is_waiting = False
            return done

        return Async(self, is_done)

    def assert_blocking(self) -> None:
        if self.is_active:
            raise RuntimeError("This can only be called before multitasking starts.")

    def finish(
        self,
        is_done: Callable[[], bool],
        result: Callable[[], Any] | None = None,
        on_close: Callable[[], None] | None = None,
        poll_ms: int = 0,
    ) -> Any:
        """Wait now, or return an awaitable. ``poll_ms``: time between checks; 0 for the next control loop."""
        if self.is_active:
            return Async(self, is_done, result, on_close)
        while not is_done():
            if poll_ms:
                self.machine.advance(poll_ms)
            else:
                self.machine.advance_to_control()
        return result() if result is not None else None

    def wait_until(self, end_ms: int, on_close: Callable[[], None] | None = None) -> Any:
        """Wait for a simulated time."""
        if self.is_active:
            return Async(self, lambda: self.machine.time_ms >= end_ms, None, on_close)
        if end_ms > self.machine.time_ms:
            self.machine.advance(end_ms - self.machine.time_ms)
        return None

    def value(self, get: Callable[[], Any]) -> Any:
        """A sensor's value, now or as an awaitable."""
        return Async(self, lambda: True, get) if self.is_active else get()

    def done(self) -> Any:
        """A command that completes immediately."""
        return self.value(lambda: None)


class Awaited:
    """The current awaited command of a device; a new one replaces it and lets its awaiter continue."""

    def __init__(self, loop: RunLoop) -> None:
        self._loop = loop
        self._current: Async | None = None

    def cancel(self) -> None:
        if self._current is not None:
            self._current._cancel()
            self._current = None

    def finish(
        self,
        is_done: Callable[[], bool],
        result: Callable[[], Any] | None = None,
        on_close: Callable[[], None] | None = None,
        poll_ms: int = 0,
    ) -> Any:
        """Cancel the previous command, then `RunLoop.finish`."""
        self.cancel()
        outcome = self._loop.finish(is_done, result, on_close, poll_ms)
        if isinstance(outcome, Async):
            self._current = outcome
        return outcome


class Context:
    """One program on one machine. ``ports``: its class ``Port``, with the ports of the hub."""

    def __init__(self, machine: Machine, console: Console, ports: type[Any]) -> None:
        self.machine, self.console, self.ports = machine, console, ports
        self.loop = RunLoop(machine)

    def port_letter(self, port: Any) -> str:
        """Letter of a ``Port``. Raises TypeError for another value."""
        expect_type(port, self.ports)
        return str(port._name)


class Native:
    """Object of the firmware, of a class that :func:`bind` made for one program.

    A call of a public method takes no simulated time, but is counted to end busy loops; errors of the motor control become the
    firmware's.
    """

    _context: Context
    _machine: Machine
    _loop: RunLoop

    def __init_subclass__(cls) -> None:
        for name, method in list(vars(cls).items()) if is_native(cls) else ():
            if isinstance(method, FunctionType) and not name.startswith("_"):
                setattr(cls, name, _counted(method))


def _counted(method: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(self: Any, *args: Any, **kwargs: Any) -> Any:
        self._machine.charge_call()
        try:
            return method(self, *args, **kwargs)
        except FIRMWARE_ERRORS as error:
            raise _of_hub(error) from None

    return call


def bind(context: Context, kind: type, *hidden: str) -> Any:
    """A subclass for one program, whose objects know the machine, without the ``hidden`` attributes."""
    names = {"_context": context, "_loop": context.loop, "_machine": context.machine, **{name: _Absent() for name in hidden}}
    return type(kind.__name__, (kind,), {**names, "__qualname__": kind.__qualname__, "__module__": kind.__module__})


def classes(context: Context, kinds: Iterable[type]) -> dict[str, Any]:
    """:func:`bind` for several classes, by name; without those that the hub lacks."""
    missing = context.machine.robot.hub.model.missing
    return {kind.__name__: bind(context, kind) for kind in kinds if kind.__name__ not in missing}


class _Absent:
    """An attribute that a kind of hub lacks."""

    def __set_name__(self, kind: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, kind: type) -> Any:
        raise AttributeError(f"'{kind.__name__}' object has no attribute '{self._name}'")

    def __set__(self, instance: Any, value: Any) -> None:
        """Without effect."""
