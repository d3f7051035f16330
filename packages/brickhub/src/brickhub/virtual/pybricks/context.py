"""Context of a program's Pybricks modules: its machine, console and run loop, and the classes that
are bound to it."""

import functools
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any

from brickhub.virtual import error_numbers
from brickhub.virtual.firmware import FIRMWARE_ERRORS, RefusedError, UnavailableError
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine
from brickhub.virtual.micropython.exceptions import is_native
from brickhub.virtual.micropython.streams import Console
from brickhub.virtual.pybricks.arguments import expect_type, os_error

_Call = Callable[[], Any]


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
        return os_error(error.errno or error_numbers.EPERM)
    if isinstance(error, RefusedError):
        return ValueError("Invalid argument")
    # The firmware raises this (PBIO_ERROR_FAILED) for a move that rounding made infeasible.
    return RuntimeError("Unknown error")


class Async:
    """Awaitable of a method in the run loop; completes with a value when ``is_done``, or when
    another command replaces it."""

    __slots__ = ("_context", "_is_done", "_on_close", "_result", "_state")

    _NEW, _RUNNING, _CANCELLED, _DONE = range(4)

    def __init__(
        self,
        context: "Context",
        is_done: Callable[[], bool],
        result: _Call | None = None,
        on_close: _Call | None = None,
    ) -> None:
        self._context = context
        self._is_done = is_done
        self._result = result
        self._on_close = on_close
        self._state = self._NEW

    def __iter__(self) -> "Async":
        return self

    def __next__(self) -> None:
        if self._state > self._RUNNING:
            raise StopIteration
        # At its first turn a command has just been given, and another task may wait for what it
        # does. So no time passes before the others have had their turn.
        self._context.is_waiting = self._state == self._RUNNING
        self._state = self._RUNNING
        if not self._is_done():
            return
        self._context.is_waiting = False
        self._state = self._DONE
        raise StopIteration(self._result() if self._result is not None else None)

    def close(self) -> None:
        """Abort: stop what was started."""
        if self._state <= self._RUNNING:
            self._state = self._CANCELLED
            if self._on_close is not None:
                self._on_close()


class Context:
    """One program on one machine: the state of ``run_task``, and waiting inside and outside of it.

    Attributes:
        ports: the program's class ``Port``, with the ports of the hub.
        start_ms: simulated time at which the program began.
        peripherals: wireless devices that the program looks for or is connected to; the hub holds
            only some.
        is_active: whether tasks run.
        is_waiting: whether the task that has just yielded has been waiting since its last turn.
            Otherwise it only lets others run, or has done something for which others may wait.
    """

    def __init__(
        self,
        machine: Machine,
        console: Console,
        ports: type[Any],
    ) -> None:
        self.machine = machine
        self.console = console
        self.ports = ports
        self.start_ms = machine.time_ms
        self.peripherals: list[Any] = []
        self.is_active = False
        self.is_waiting = False

    def port_letter(self, port: Any) -> str:
        """Letter of a ``Port``, or its number. Raises TypeError for another value."""
        expect_type(port, self.ports)
        return str(port._name).removeprefix("S")

    def yield_once(self) -> Async:
        """An awaitable that only yields to other tasks."""
        # The operation is not done when it is first asked, but when it is asked again.
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
        result: _Call | None = None,
        on_close: _Call | None = None,
        *,
        poll_ms: int = 0,
    ) -> Any:
        """Wait now, or return an awaitable. ``poll_ms``: time between checks; 0 for the next
        control loop."""
        if self.is_active:
            return Async(self, is_done, result, on_close)
        while not is_done():
            # Motors change only in a control loop, so nothing needs to be looked at before the next
            # one.
            to_next_loop_ms = CONTROL_LOOP_MS - self.machine.time_ms % CONTROL_LOOP_MS
            self.machine.advance(poll_ms or to_next_loop_ms)
        return result() if result is not None else None

    def wait_until(self, end_ms: int) -> Any:
        """Wait for a simulated time."""
        if self.is_active:
            return Async(self, lambda: self.machine.time_ms >= end_ms)
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
    """The current awaited command of a device; a new one replaces it and lets its awaiter
    continue."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._current: Async | None = None

    def cancel(self) -> None:
        if self._current is not None:
            self._current._state = Async._CANCELLED
            self._current = None

    def finish(
        self,
        is_done: Callable[[], bool],
        *callbacks: _Call | None,
        poll_ms: int = 0,
    ) -> Any:
        """Cancel the previous command, then `Context.finish`."""
        self.cancel()
        outcome = self._context.finish(is_done, *callbacks, poll_ms=poll_ms)
        if isinstance(outcome, Async):
            self._current = outcome
        return outcome


class Native:
    """Object of the firmware, of a class that :func:`bind` made for one program.

    A call of a public method takes no simulated time, but is counted to end busy loops; errors of
    the motor control become the firmware's.
    """

    _context: Context
    _machine: Machine

    def __init_subclass__(cls) -> None:
        # A program's own subclass is no class of the firmware: its methods are byte code.
        if not is_native(cls):
            return
        for name, method in list(vars(cls).items()):
            if isinstance(method, FunctionType) and not name.startswith("_"):
                setattr(cls, name, _counted(method))


def _counted(method: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(
        self: Any,
        *args: Any,
        **kwargs: Any,
    ) -> Any:
        self._machine.charge_call()
        try:
            return method(self, *args, **kwargs)
        except FIRMWARE_ERRORS as error:
            raise _of_hub(error) from None

    return call


def bind(
    context: Context,
    kind: type,
    *hidden: str,
) -> Any:
    """A subclass for one program, whose objects know the machine, without the ``hidden``
    attributes."""
    names: dict[str, Any] = {"_context": context, "_machine": context.machine}
    for name in hidden:
        names[name] = _Absent()
    # The class passes for the firmware's own, even in what it prints.
    names["__qualname__"] = kind.__qualname__
    names["__module__"] = kind.__module__
    return type(kind.__name__, (kind,), names)


def classes(context: Context, kinds: Iterable[type]) -> dict[str, Any]:
    """:func:`bind` for several classes, by name; without those that the hub lacks."""
    missing = context.machine.robot.hub.model.missing
    bound = {}
    for kind in kinds:
        if kind.__name__ not in missing:
            bound[kind.__name__] = bind(context, kind)
    return bound


class _Absent:
    """An attribute that a kind of hub lacks."""

    def __set_name__(
        self,
        kind: type,
        name: str,
    ) -> None:
        self._name = name

    def __get__(
        self,
        instance: Any,
        kind: type,
    ) -> Any:
        raise AttributeError(f"'{kind.__name__}' object has no attribute '{self._name}'")

    def __set__(
        self,
        instance: Any,
        value: Any,
    ) -> None:
        """Do nothing, because the attribute cannot be set."""
