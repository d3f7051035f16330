"""End of a command that somebody else asks for: a signal, a closed terminal, or the end of the
process that started it.

The command ends in order, as by Ctrl-C, and has :data:`DEADLINE_S` for it. Then its process ends,
whatever its threads do. Windows has no SIGTERM and no SIGHUP that a program could handle: there a
closed terminal ends the process at once, and a parent's pipe, which works on every system, is the
way to ask for an end.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from brickhub.cli.descendants import kill_frozen
from brickhub.cli.key_listener import interrupt_main
from brickhub.cli.signals import INTERRUPTED, end_signals

DEADLINE_S = 3.5
"""Time for an end in order."""
_NOTE_S = 1.0
"""Time in which most commands have ended, so that nothing needs to be said."""
_AGAIN_S = 5.0
"""Time after which a Ctrl-C that has not ended the command yet is answered, and is again."""


def end_after(duration_s: float) -> None:
    """End this process after a time, whatever its threads do then, and those that it has started:
    they end by themselves, and frozen ones are killed."""

    def end() -> None:
        time.sleep(duration_s)
        # Frozen children are killed first, while they can still be found as descendants of this
        # process.
        kill_frozen(os.getpid())
        os._exit(INTERRUPTED)

    threading.Thread(
        target=end,
        name="brickhub-deadline",
        daemon=True,
    ).start()


@dataclass
class End:
    """End of a command.

    Attributes:
        is_asked: set when it has to end before the deadline.
        saves: whether the command may take longer after the first Ctrl-C, to save what it has.
        is_said: set when the command has said its last line.
    """

    is_asked: threading.Event = field(default_factory=threading.Event)
    saves: bool = True
    is_said: threading.Event = field(default_factory=threading.Event)


@contextlib.contextmanager
def ended_in_time() -> Iterator[End]:
    """Context of a command in the main thread, with what is known of its end.

    The signals of `end_signals` are a Ctrl-C to it, and it ends before the deadline, also if the
    main thread is busy. A second Ctrl-C has the same deadline; so has the first if the command
    saves nothing. One that does says that it does, for as long as it takes.
    """
    numbers = end_signals()
    handlers = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    # Python runs handlers in the main thread, which a library may keep busy for seconds. So the
    # number of each signal is also written to this pair at once, for a thread that waits for it.
    # Windows takes only a socket here, not a pipe.
    numbers_of_signals, tell = socket.socketpair()
    tell.setblocking(False)
    wakeup_before = signal.set_wakeup_fd(tell.fileno(), warn_on_full_buffer=False)
    end = End()
    watcher = threading.Thread(
        target=_watch_signals,
        args=(numbers_of_signals, frozenset(numbers), end),
        name="brickhub-signals",
        daemon=True,
    )
    watcher.start()
    try:
        yield end
    finally:
        signal.set_wakeup_fd(wakeup_before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        # Closing this end lets the watcher read its end, and stop.
        tell.close()


def _watch_signals(
    source: socket.socket,
    numbers: frozenset[int],
    end: End,
) -> None:
    """Set the deadline at the first signal that ends the command, or at the last Ctrl-C that it
    waits for."""
    interrupts = 0
    with source:
        # Later ones are read as well: Python says in many lines that nobody reads them.
        while data := source.recv(1):
            number = data[0]
            if end.is_asked.is_set():
                continue
            if number == signal.SIGINT:
                interrupts += 1
            # This is asked again at each signal, because it is known only from its beginning on
            # whether a command saves anything.
            patience = 1 if end.saves else 0
            if number in numbers or interrupts > patience:
                end.is_asked.set()
                end_after(DEADLINE_S)
            elif number == signal.SIGINT:
                threading.Thread(
                    target=_answer_interrupt,
                    args=(end,),
                    name="brickhub-interrupt",
                    daemon=True,
                ).start()


def _answer_interrupt(end: End) -> None:
    """Say what a Ctrl-C waits for, until the command has said how it ended."""
    if end.is_said.wait(_NOTE_S):
        return
    # Writing fails if the terminal has been closed in the meantime.
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write("ending, and saving first; another Ctrl-C ends at once\n")
        for number in itertools.count(1):
            if end.is_said.wait(_AGAIN_S):
                return
            duration_s = _NOTE_S + number * _AGAIN_S
            sys.stderr.write(f"still saving, for {duration_s:.0f} s; another Ctrl-C ends at once\n")


def take_input() -> int:
    """Descriptor of standard input, whose place nothing takes. Nobody else reads it from then on:
    also no process that is started, which on Windows would wait for its reader."""
    taken = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    return taken


def end_with_parent() -> None:
    """End this command when standard input ends, which its parent holds open for as long as it
    lives. The command itself reads nothing from then on."""
    held = take_input()

    def watch() -> None:
        # What the parent writes does not matter, only that it holds the pipe open.
        with contextlib.suppress(OSError):
            while os.read(held, 64):
                pass
        end_after(DEADLINE_S)
        # The signal goes to the main thread itself, because only that interrupts its blocking call.
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
        else:
            interrupt_main()

    threading.Thread(
        target=watch,
        name="brickhub-parent",
        daemon=True,
    ).start()


def wait_for_end() -> None:
    """Wait for Ctrl-C, or another end. Raises KeyboardInterrupt."""
    while True:
        # Unlike waiting for a lock, sleeping can be interrupted on Windows too.
        time.sleep(1.0)
