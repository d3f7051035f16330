"""Terminal of a command that learns: slow imports, the robot that is placed or driven by hand, keys
and signals that stop it."""

from __future__ import annotations

import contextlib
import importlib
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, Self, get_args

from brickhub.cli.key_listener import can_listen, interrupt_main, keys_heard
from brickhub.cli.signals import end_signals, ending_at_once
from brickhub.cli.terminal import print_error, print_line
from bricksrl.envs.env_interface import BricksEnv, interface_of
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import is_simulation
from bricksrl.errors import BricksError, RunError
from bricksrl.teleoperation import DISCARD_KEY, DRIVERS, KeyboardDriver, Paced, legend
from bricktwin.twin.make_body import check_mujoco

if TYPE_CHECKING:
    import numpy as np
    from prompt_toolkit.input import Input
    from torchrl.envs import EnvBase

    from bricksrl.envs.connection import Placement
    from bricksrl.envs.rollout import Driver
    from bricksrl.envs.task import Task


_SLOW_IMPORTS = ("torch", "torchrl.data", "torchrl.envs")


def placing(*quiet: Callable[[], AbstractContextManager[None]]) -> Placement:
    """Placement that asks the user to put a real robot at the start, and waits for Enter, inside
    these contexts. It raises RunError if standard input has ended."""

    def place(_rng: np.random.Generator) -> None:
        with contextlib.ExitStack() as stack:
            for context in quiet:
                stack.enter_context(context())
            sys.stderr.write("put the robot where an episode starts, then press Enter ")
            sys.stderr.flush()
            if not (sys.stdin and sys.stdin.readline()):
                sys.stderr.write("\n")
                raise RunError(
                    "nobody can be asked to place the robot: standard input is not a terminal; "
                    "start this in one"
                )

    return place


def load_learning() -> None:
    """Import torch and TorchRL. They may ignore an exception of a Ctrl-C, and take long, so that it
    ends the process at once: there is nothing to save yet, and no robot."""
    handlers = ending_at_once()
    try:
        check_mujoco()
        for name in _SLOW_IMPORTS:
            importlib.import_module(name)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


_TELL_S = 8.0
"""Time after which somebody who waits begins to wonder whether anything happens."""


@contextmanager
def telling(what: str) -> Iterator[None]:
    """Print what is done at the start of this context, and from time to time while it lasts."""
    ended = threading.Event()
    start_s = time.monotonic()
    print_line(what)

    def tell() -> None:
        while not ended.wait(_TELL_S):
            print_line(f"{what}, for {time.monotonic() - start_s:.0f} s now")

    thread = threading.Thread(
        target=tell,
        name="bricksrl-telling",
        daemon=True,
    )
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


STOP_KEYS = (" ", "q", "escape")
PAUSE_KEY = "p"
DISCARD_LEGEND = "Backspace discards this episode, and records it again"
LEGEND = "keys: space, q or Esc stops the robot at once; p pauses it, and p again lets it go on"
_JOIN_TIMEOUT_S = 10.0


def stop_signals() -> list[signal.Signals]:
    """Signals that stop the robot, and end the run: SIGUSR1 and those that end a command. Windows
    has Ctrl-Break only."""
    # Windows has no signals for a user's own use.
    user_signals = [signal.SIGUSR1] if hasattr(signal, "SIGUSR1") else []
    return [*user_signals, *end_signals()]


class EmergencyStop:
    """Emergency stop: while entered, keys stop or pause the robot, and signals stop it. Signals
    need the main thread.

    Requests are executed in a separate thread, since a signal may arrive while the main thread
    holds any lock.

    Args:
        stop: set when the robot is stopped, so that the run ends.
        notify: prints a line for the user.
        keys: whether to listen to keys; by default if there is a terminal.
        source: source of the keys; by default the terminal.
        on_discard: called when Backspace is pressed, where an episode can be discarded.
    """

    def __init__(
        self,
        stop: threading.Event,
        notify: Callable[[str], None],
        *,
        keys: bool | None = None,
        source: Input | None = None,
        on_discard: Callable[[], None] | None = None,
    ) -> None:
        self._stop = stop
        self._on_discard = on_discard
        self._notify = notify
        self._env = BricksEnv()
        self._requests: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._worker = threading.Thread(
            target=self._work,
            name="bricksrl-emergency-stop",
            daemon=True,
        )
        self._keys = can_listen() if keys is None else keys
        self._source = source
        self._handlers = contextlib.ExitStack()
        self._listener = contextlib.ExitStack()

    def attach(self, env: EnvBase) -> None:
        """Set the environment to stop and pause. For a simulation, which cannot pause, stop is the
        same as Ctrl-C."""
        self._env = interface_of(env)
        if self._stop.is_set():
            self._requests.put("stop")

    def __enter__(self) -> Self:
        self._worker.start()
        # Python lets only the main thread handle signals.
        if threading.current_thread() is threading.main_thread():
            for number in stop_signals():
                before = signal.signal(number, lambda *_: self._requests.put("stop"))
                self._handlers.callback(signal.signal, number, before)
        if self._keys:
            self._listener.enter_context(keys_heard(self._on_key, self._source))
            self._notify(LEGEND)
            if self._on_discard is not None:
                self._notify(DISCARD_LEGEND)
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._handlers.close()
        self._requests.put("end")
        self._worker.join(_JOIN_TIMEOUT_S)

    @contextmanager
    def quiet(self) -> Iterator[None]:
        """Ignore keys inside this context, so that they can answer a question on the terminal."""
        self._listener.close()
        try:
            yield
        finally:
            if self._keys:
                self._listener.enter_context(keys_heard(self._on_key, self._source))

    def _on_key(self, key: str) -> None:
        if key in STOP_KEYS:
            self._requests.put("stop")
        elif key == PAUSE_KEY:
            self._requests.put("pause")
        elif key == DISCARD_KEY and self._on_discard is not None:
            self._on_discard()

    def _work(self) -> None:
        while (request := self._requests.get()) != "end":
            try:
                self._stop_robot() if request == "stop" else self._pause_robot()
            except BricksError as error:
                # The hub could not be reached; its watchdog stops it.
                print_error(str(error))
            except OSError:
                # Nobody reads what we say, as the terminal is closed; later requests are executed
                # all the same.
                pass

    def _stop_robot(self) -> None:
        if not self._env.robots:
            # Nothing moves: it is the same as Ctrl-C.
            interrupt_main()
            return
        # First the flag, so that no step follows the one that is stopped.
        self._stop.set()
        self._env.stop()
        self._notify("stopped by hand")

    def _pause_robot(self) -> None:
        env = self._env
        if not env.robots:
            self._notify("nothing to pause here")
        elif env.is_paused:
            env.resume()
            self._notify("goes on")
        else:
            env.pause()
            self._notify("pauses after this step; p lets it go on")


Device = Literal["keyboard", "gamepad", "controller"]
DEVICES = get_args(Device)


def with_human(options: EnvOptions, env: str) -> EnvOptions:
    """Options of an environment in which a human drives: a virtual robot moves in real time. A real
    one does anyway, and for a simulation `driving` keeps the pace."""
    if options.hub == "virtual" and not is_simulation(env):
        return replace(options, realtime=True)
    return options


@contextmanager
def driving(
    device: str | None,
    env: str,
    task: Task,
    *,
    in_charge: bool,
    on_discard: Callable[[], None] | None = None,
) -> Iterator[Driver | None]:
    """The driver of a keyboard, a gamepad or a Controller of LEGO's kits, after printing the keys'
    meanings; ``None`` for no device. ``on_discard`` is called when Backspace is pressed on a
    keyboard that drives. Raises DataError if the device is not available."""
    if device is None:
        yield None
        return
    commands = [command.entry for command in task.interface.commands]
    with DRIVERS[device](commands, in_charge=in_charge) as driver:
        if device == "keyboard":
            for line in legend(commands):
                print_line(line)
        if isinstance(driver, KeyboardDriver) and on_discard is not None:
            driver.on_discard = on_discard
            print_line(DISCARD_LEGEND)
        yield Paced(driver, task.rate_hz) if is_simulation(env) else driver


def quiet(driver: object) -> AbstractContextManager[None]:
    """Context in which the driver ignores keys, so that they can answer a question on the
    terminal."""
    return driver.quiet() if isinstance(driver, KeyboardDriver) else nullcontext()
