"""Ends of a command that somebody else asks for."""

from __future__ import annotations

import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from brickhub.cli import ending

if os.name != "posix":
    pytest.skip("signals of POSIX", allow_module_level=True)  # whose names are missing elsewhere

LONGEST_S = 30.0
BEGIN = """
import sys, time
def ready():
    print("ready", flush=True)
"""
SOON = """
import signal
from brickhub.cli import ending
ending.DEADLINE_S = 0.3
"""
DEAF = (
    SOON
    + """
with ending.ended_in_time():
    is_ready = False
    while True:
        try:
            if not is_ready:
                ready()
                is_ready = True
            time.sleep(60)
        except KeyboardInterrupt:
            print("heard", flush=True)
"""
)
IN_C = (
    SOON
    + """
import hashlib
with ending.ended_in_time():
    ready()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
"""
)
WITH_PARENT = (
    SOON
    + """
with ending.ended_in_time():
    ending.end_with_parent()
    assert sys.stdin.readline() == "", "the command itself reads nothing"
    ready()
    ending.wait_for_end()
"""
)
ORDERLY = (
    SOON
    + """
from brickhub import cli
class Line:
    @staticmethod
    def run(line, arguments, begin):
        begin(None)
        ready()
        ending.wait_for_end()
sys.modules["brickhub.cli.app"] = Line
cli.app = Line
sys.modules["table"] = type("Table", (), {"LINE": None})
try:
    sys.exit(cli.start("table", None))
finally:
    print("the interpreter ends by itself", flush=True)
"""
)


@pytest.fixture(autouse=True)
def _closed_terminal_is_heard() -> Iterator[None]:
    """A script hears that its terminal is closed, also where ``nohup`` started the tests."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@contextmanager
def running(script: str, **options: object) -> Iterator[subprocess.Popen[str]]:
    """A script that has said that it is ready."""
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN + script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        **options,
    )
    with process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("script", [DEAF, IN_C])
def test_deaf_command_ends_at_the_deadline(script: str, number: signal.Signals) -> None:
    with running(script) as process:
        time.sleep(0.1)
        process.send_signal(number)
        assert process.wait(LONGEST_S) == 130


def test_only_the_second_interrupt_has_a_deadline_where_something_is_saved() -> None:
    notes = "ending._NOTE_S, ending._AGAIN_S = 0.1, 0.2\n"
    with running(DEAF.replace("with", notes + "with"), stderr=subprocess.PIPE) as process:
        process.send_signal(signal.SIGINT)
        assert process.stdout is not None and process.stdout.readline() == "heard\n"
        assert process.stderr is not None
        assert process.stderr.readline().startswith("ending, and saving first; another Ctrl-C")
        assert process.stderr.readline().startswith("still saving, for 0 s; another Ctrl-C")
        assert process.stderr.readline().startswith("still saving, for 0 s; another Ctrl-C")
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(LONGEST_S) == 130


class _SaidInTheEnd(threading.Event):
    """Set at the fourth look; the times that were waited for are kept."""

    def __init__(self) -> None:
        super().__init__()
        self.waited_s: list[float | None] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.waited_s.append(timeout)
        return len(self.waited_s) == 4


def test_who_waits_is_told_after_a_second_and_then_each_five(
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = _SaidInTheEnd()
    ending._answer_interrupt(ending.End(is_said=said))
    assert said.waited_s == [1.0, 5.0, 5.0, 5.0]
    _, *still = capsys.readouterr().err.splitlines()
    assert [line.split(";")[0] for line in still] == [
        "still saving, for 6 s",
        "still saving, for 11 s",
    ]


def test_first_interrupt_has_a_deadline_where_nothing_is_saved() -> None:
    script = DEAF.replace("ended_in_time():", "ended_in_time() as end:\n    end.saves = False")
    with running(script) as process:
        process.send_signal(signal.SIGINT)
        assert process.wait(LONGEST_S) == 130


def test_signals_after_the_last_that_counts_are_quiet() -> None:
    """Whoever waits too long sends a second one; a command may also raise one for itself."""
    quiet = DEAF.replace('print("heard", flush=True)', "pass")
    with running(quiet, stderr=subprocess.PIPE) as process:
        for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGINT):
            process.send_signal(number)
            time.sleep(0.05)
        _, error = process.communicate(timeout=LONGEST_S)
        assert (process.returncode, error) == (130, "")


def test_command_under_nohup_hears_no_closed_terminal() -> None:
    with running(DEAF, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)) as process:
        process.send_signal(signal.SIGHUP)
        time.sleep(0.6)
        assert process.poll() is None


WITH_CHILDREN = (
    SOON
    + """
import os, subprocess
code = "import os, signal, subprocess, sys, time\\n" \\
    "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'], " \\
    "start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)\\n" \\
    "child.send_signal(signal.SIGSTOP)\\n" \\
    "print(child.pid, flush=True); time.sleep(5)"
child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
frozen = child.stdout.readline()
with ending.ended_in_time():
    ready()
    print(frozen, flush=True)
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""
)


def test_frozen_descendants_do_not_outlive_a_command() -> None:
    with running(WITH_CHILDREN) as process:
        assert process.stdout is not None
        frozen = int(process.stdout.readline())
        time.sleep(0.1)
        process.send_signal(signal.SIGTERM)
        assert process.wait(LONGEST_S) == 130
        limit_s = time.monotonic() + LONGEST_S
        try:
            while is_there(frozen):
                assert time.monotonic() < limit_s
                time.sleep(0.02)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(frozen, signal.SIGKILL)


def is_there(pid: int) -> bool:
    """Whether a process is there, and no zombie that nobody has waited for."""
    with contextlib.suppress(OSError):
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_command_ends_with_its_parent() -> None:
    with running(WITH_PARENT) as process:
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(LONGEST_S) != 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_command_that_was_ended_does_not_wait_for_the_interpreter(number: signal.Signals) -> None:
    with running(ORDERLY, stderr=subprocess.PIPE) as process:
        process.send_signal(number)
        said, error = process.communicate(timeout=LONGEST_S)
        assert process.returncode == 130 and not said and "nothing was saved" in error


LOADING = """
import importlib.abc
class Slow(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == PLACE:
            ready()
            try:
                time.sleep(60)
            except BaseException:  # as some libraries do
                time.sleep(60)
sys.meta_path.insert(0, Slow())
from brickhub import cli
sys.argv[1:] = ["scan", "--hub", "virtual"]
sys.exit(cli.main())
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize(
    "place",
    ["brickhub.cli.ending", "brickhub.cli.app", "tyro", "brickhub.cli.command_table", "asyncio"],
)
def test_command_that_is_ended_while_it_imports_says_one_line(
    place: str, number: signal.Signals
) -> None:
    with running(f"PLACE = {place!r}\n" + LOADING, stderr=subprocess.PIPE) as process:
        process.send_signal(number)
        said, error = process.communicate(timeout=LONGEST_S)
        assert (process.returncode, said) == (130, "")
        assert error == "interrupted: nothing was saved\n"


def test_command_whose_terminal_is_closed_ends() -> None:
    read, write = os.pipe()
    with running(ORDERLY, stderr=write) as process:
        os.close(read)
        os.close(write)
        process.send_signal(signal.SIGHUP)
        assert process.wait(LONGEST_S) == 130
