"""``pybricks.tools``."""

import math
from collections.abc import Callable, Iterator
from inspect import isgeneratorfunction
from types import FunctionType, ModuleType
from typing import Any

from brickhub.errors import TwinError
from brickhub.virtual.micropython.iterables import close
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.arguments import get_int
from brickhub.virtual.pybricks.context import Context, Native, bind
from brickhub.virtual.pybricks.hub_panel import LightMatrix
from brickhub.virtual.pybricks.matrix import Matrix, cross, vector
from brickhub.virtual.pybricks.parameters import Axis

_DONE = object()


class StopWatch(Native):
    """Time in ms since construction or reset, without pauses."""

    def __init__(
        self,
        *_unused: Any,
        **_named: Any,
    ) -> None:
        self._start = self._machine.time_ms
        self._pause: int | None = None

    def time(self) -> int:
        now_ms = self._machine.time_ms if self._pause is None else self._pause
        return now_ms - self._start

    def running(self) -> bool:
        return self._pause is None

    def pause(self) -> None:
        if self._pause is None:
            self._pause = self._machine.time_ms

    def resume(self) -> None:
        # Moving the start by the length of the pause leaves the pause out of the time.
        if self._pause is not None:
            self._start += self._machine.time_ms - self._pause
            self._pause = None

    def reset(self) -> None:
        self._start = self._machine.time_ms
        if self._pause is not None:
            self._pause = self._start


class Task:
    """``multitask(...)``: tasks in turns until all, or with ``race`` one, are done."""

    _context: Context

    def __init__(
        self,
        *tasks: Any,
        **race: Any,
    ) -> None:
        self._tasks = tasks
        self._iterators: list[Iterator[Any]] = [_iterator(task) for task in tasks]
        self._results: list[Any] = [None] * len(tasks)
        self._open = list(range(len(tasks)))
        # The firmware does not look at the name of the argument.
        is_race = len(race) == 1 and all(race.values())
        self._required = 1 if is_race else len(tasks)

    def __iter__(self) -> "Task":
        return self

    def __next__(self) -> None:
        context = self._context
        # A set of tasks waits only while each of its tasks waits, and then time may pass.
        all_wait = True
        try:
            for index in tuple(self._open):
                context.is_waiting = False
                try:
                    next(self._iterators[index])
                except StopIteration as stop:
                    all_wait = False
                    self._results[index] = stop.value
                    self._open.remove(index)
                    if len(self._tasks) - len(self._open) >= self._required:
                        break
                else:
                    all_wait = all_wait and context.is_waiting
        # A task that fails ends the others too.
        except BaseException:
            self.close()
            raise
        if len(self._tasks) - len(self._open) >= self._required:
            self.close()
            context.is_waiting = False
            raise StopIteration(tuple(self._results))
        context.is_waiting = all_wait

    def close(self) -> None:
        for index in self._open:
            if hasattr(self._tasks[index], "close"):
                close(self._tasks[index])
        self._open = []


def _duration_ms(time: Any) -> int:
    """Milliseconds of a number. Infinity ends at once, as in the firmware's build for a computer; a
    hub waits for 24 days."""
    return 0 if time in (math.inf, -math.inf) else get_int(time)


def _character(byte: int) -> str | None:
    """A printable character; ``None`` for others."""
    return bytes((byte,)).decode() if 32 <= byte <= 126 else None


def _iterator(task: Any) -> Iterator[Any]:
    """Iterator of a task; raises TypeError for an uncalled one."""
    if isinstance(task, FunctionType) and isgeneratorfunction(task):
        raise TypeError("'generator' object isn't iterable")
    return iter(task)


def tools_module(context: Context, app_data: type[Any]) -> ModuleType:
    """``pybricks.tools``, which also has the old ``AppData``."""
    machine = context.machine
    hub = machine.robot.hub.model

    def wait(time: Any) -> Any:
        # This is called often and mostly with a plain integer, which needs no further call.
        duration_ms = time if type(time) is int else _duration_ms(time)
        # In a task, wait(0) lets the others have their turn.
        if context.is_active and duration_ms == 0:
            return context.yield_once()
        if not context.is_active and duration_ms <= 0:
            return machine.charge_call()
        return context.wait_until(machine.time_ms + duration_ms)

    def run_task(task: Any = None) -> bool | None:
        if task is None:
            return context.is_active
        if context.is_active:
            raise RuntimeError("Run loop already active.")
        context.is_active = True
        context.is_waiting = False
        try:
            iterator = _iterator(task)
            while next(iterator, _DONE) is not _DONE:
                # Time passes only if nobody has anything to do. A task that has just yielded goes
                # on in the same millisecond.
                if context.is_waiting:
                    machine.advance(1)
                else:
                    machine.charge_call()
                context.is_waiting = False
                machine.branch(None)
        finally:
            context.is_active = False
        return None

    def read_input_byte(last: Any = False, chr: Any = False) -> int | str | None:
        machine.charge_call()
        count = context.console.available()
        if not count:
            return None
        # With `last`, everything that has come in is read, and only the last byte counts.
        byte = context.console.read(count if last else 1)[-1]
        return _character(byte) if chr else byte

    def hub_menu(*entries: Any) -> Any:
        if len(entries) < 2:
            raise TypeError(f"function missing {2 - len(entries)} required positional arguments")
        return _menu(context, entries)

    names = {
        "AppData": app_data,
        "StopWatch": bind(context, StopWatch),
        "multitask": bind(context, Task),
    }
    if hub.has_float:
        names |= {"Matrix": Matrix, "vector": vector, "cross": cross, "Axis": Axis}
    functions: list[Callable[..., Any]] = [wait, run_task, read_input_byte]
    if hub.has_display:
        functions.append(hub_menu)
    return module("tools", names, *functions)


def _menu(context: Context, entries: tuple[Any, ...]) -> Any:
    """The entry selected by the left, right and center buttons. Raises TwinError if nobody can
    press them."""
    machine = context.machine
    display = bind(context, LightMatrix)()
    panel = context.machine.panel
    # Each entry is shown once, so that a wrong one is refused at the start. The first one stays on
    # the display.
    for entry in reversed(entries):
        display._show_symbol(entry)
    context.assert_blocking()

    def wait_for_buttons(pressed: bool) -> frozenset[str]:
        while True:
            down = panel.pressed(machine.time_ms)
            if bool(down) is pressed:
                return down
            if pressed and panel.is_unattended:
                raise TwinError(
                    "hub_menu waits for a button, and nobody presses one; choose with --press "
                    '"right@1s" --press "center@2s"'
                )
            machine.advance(1)

    # In the menu the center button selects, instead of stopping the program.
    stop_buttons = panel.stop_buttons
    if stop_buttons != {"bluetooth"}:
        panel.stop_buttons = frozenset()
    try:
        selected = 0
        while True:
            # A press may last for many polls but should move by one entry, so its end is awaited.
            wait_for_buttons(pressed=False)
            down = wait_for_buttons(pressed=True)
            if "center" in down:
                break
            step = 0
            if "right" in down:
                step = 1
            elif "left" in down:
                step = -1
            selected = (selected + step) % len(entries)
            display._show_symbol(entries[selected])
        # The button that selected would otherwise stop the program at once.
        wait_for_buttons(pressed=False)
    finally:
        panel.stop_buttons = stop_buttons
    return entries[selected]
