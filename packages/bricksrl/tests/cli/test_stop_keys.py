"""Keys and signals for stop and pause."""

from __future__ import annotations

import functools
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from forked import ForkServer, Scratch
from prompt_toolkit.input import create_pipe_input
from torchrl.envs import ParallelEnv

import bricksrl
from bricksrl.cli.terminal import DISCARD_LEGEND, LEGEND, EmergencyStop, stop_signals
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import HubError

pytestmark = pytest.mark.realtime

BOUND_S = 5.0


def eventually(is_so: Callable[[], object], bound_s: float = BOUND_S) -> None:
    start_s = time.monotonic()
    while not is_so():
        assert time.monotonic() - start_s < bound_s
        time.sleep(0.005)


class Robot(BricksEnv):
    """An environment that records requests."""

    robots = 1

    def __init__(self) -> None:
        self.wanted: list[str] = []

    @property
    def is_paused(self) -> bool:
        return self.wanted[-1:] == ["pause"]

    def stop(self) -> None:
        self.wanted.append("stop")

    def pause(self) -> None:
        self.wanted.append("pause")

    def resume(self) -> None:
        self.wanted.append("resume")


@contextmanager
def laid_on(robot: object) -> Iterator[tuple[threading.Event, list[str], Callable[[str], None]]]:
    """An emergency stop with its messages and keys."""
    stop, told = threading.Event(), list[str]()
    with (
        create_pipe_input() as source,
        EmergencyStop(stop, told.append, keys=True, source=source) as emergency_stop,
    ):
        emergency_stop.attach(robot)
        yield stop, told, source.send_text


def makes_ctrl_c(press: Callable[[], object]) -> None:
    """Expect Ctrl-C from a key."""
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        press()
        eventually(lambda: False)


@pytest.mark.parametrize("key", [" ", "q", "\x1b"])
def test_key_stops_robot_and_run(key: str) -> None:
    robot = Robot()
    with laid_on(robot) as (stop, told, press):
        assert told == [LEGEND]
        press(key)
        eventually(stop.is_set)
        eventually(lambda: "stopped by hand" in told)
    assert robot.wanted == ["stop"]


def test_p_pauses_and_resumes() -> None:
    robot = Robot()
    with laid_on(robot) as (stop, told, press):
        press("p")
        eventually(lambda: robot.wanted == ["pause"])
        press("xyp")
        eventually(lambda: robot.wanted == ["pause", "resume"])
        eventually(lambda: told[-1] == "goes on")
        assert not stop.is_set()


def test_backspace_discards_where_something_is_recorded() -> None:
    stop, told, pressed = threading.Event(), list[str](), threading.Event()
    with (
        create_pipe_input() as source,
        EmergencyStop(
            stop, told.append, keys=True, source=source, on_discard=pressed.set
        ) as emergency_stop,
    ):
        emergency_stop.attach(Robot())
        source.send_text("\x7f")
        eventually(pressed.is_set)
    assert told == [LEGEND, DISCARD_LEGEND] and not stop.is_set()


def test_unreachable_robot_prints_one_line(capfd) -> None:
    robot = Robot()

    def unreachable() -> None:
        raise HubError("the link is lost; the hub stops by itself")

    robot.stop = unreachable
    with laid_on(robot) as (stop, _, press):
        press("q")
        eventually(stop.is_set)
        robot.stop = lambda: robot.wanted.append("stop")
        press("q")
        eventually(lambda: robot.wanted == ["stop"])
    assert capfd.readouterr().err == "error: the link is lost; the hub stops by itself\n"


def test_stop_without_motion_is_ctrl_c() -> None:
    with laid_on(object()) as (stop, told, press):
        press("p")
        eventually(lambda: told[-1] == "nothing to pause here")
        makes_ctrl_c(lambda: press("q"))
        assert not stop.is_set()


@pytest.mark.parametrize("number", stop_signals())
def test_signal_stops_robot_while_lock_is_held(number: int) -> None:
    robot, stop, lock = Robot(), threading.Event(), threading.Lock()
    robot.stop = lambda: [
        lock.acquire(timeout=BOUND_S),
        robot.wanted.append("stop"),
        lock.release(),
    ]
    before = signal.getsignal(number)
    with EmergencyStop(stop, lambda line: None, keys=False) as emergency_stop:
        emergency_stop.attach(robot)
        with lock:
            signal.raise_signal(number)
        eventually(lambda: robot.wanted == ["stop"])
    assert stop.is_set() and signal.getsignal(number) == before


def test_later_robot_is_stopped_too() -> None:
    first, second = Robot(), Robot()
    with laid_on(first) as (stop, _, press):
        press("q")
        eventually(stop.is_set)
    with (
        create_pipe_input() as source,
        EmergencyStop(stop, lambda line: None, keys=True, source=source) as emergency_stop,
    ):
        emergency_stop.attach(second)
        eventually(lambda: second.wanted == ["stop"])


# ---- the real command

TRAIN = ("train", "RunAway-v0", "--episodes", "400", "--realtime")


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_signal_ends_training_and_saves(start, tmp_path) -> None:
    run = tmp_path / "run"
    child = start(*TRAIN[:-1], "--run", str(run))
    eventually(
        lambda: (
            (run / "metrics.csv").exists()
            and len((run / "metrics.csv").read_text().splitlines()) > 1
        ),
        90.0,
    )
    child.send_signal(signal.SIGUSR1)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 130
    assert re.fullmatch(r"stopped by hand\ninterrupted: saved \d+ episodes? in [^\n]+\n", err), err


@pytest.mark.skipif(os.name != "posix", reason="a terminal of POSIX")
@pytest.mark.usefixtures("forked_children")
def test_keys_in_a_terminal(processes: ForkServer | Scratch, tmp_path) -> None:
    import pty
    import select
    import termios

    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    command = [*TRAIN, "--run", str(tmp_path / "run")]
    environment = {**os.environ, "MUJOCO_GL": "disable", "TERM": "xterm"}
    screen = b""

    def until(text: bytes) -> None:
        nonlocal screen
        end_s = time.monotonic() + 90.0
        while text not in screen:
            assert time.monotonic() < end_s, screen
            if select.select([master], [], [], 0.1)[0]:
                screen += os.read(master, 4096)

    login = "import os, sys, fcntl, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    login += "from bricksrl.cli import main; sys.exit(main())"
    with os.fdopen(slave, "r+b", 0, closefd=False) as terminal:
        child = processes.start(
            command,
            (terminal, terminal, terminal),
            folder=str(tmp_path),
            environment=environment,
            script=login,
        )
    try:
        until(LEGEND.encode()[:30])
        until(b"seed 0")
        os.write(master, b"p")
        until(b"pauses after this step")
        os.write(master, b"p")
        until(b"goes on")
        os.write(master, b"q")
        until(b"stopped by hand")
        until(b"interrupted: ")
        assert child.wait(timeout=30) == 130
    finally:
        if child.poll() is None:
            child.kill()
    after = termios.tcgetattr(slave)
    os.close(master)
    os.close(slave)
    assert after == before, "the terminal is as it was"


def test_copies_in_processes_that_have_not_started_can_be_taken() -> None:
    env = ParallelEnv(2, functools.partial(bricksrl.make, "RunAway-v0"))
    with EmergencyStop(threading.Event(), lambda line: None, keys=False) as emergency_stop:
        emergency_stop.attach(env)
