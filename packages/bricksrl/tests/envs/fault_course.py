"""Seeded faults during training over the simulated radio.

Each fault hits one phase: search, download, start, step, reset or close. The training is the
project's own loop (``play``) with a learner that checks its input.
"""

from __future__ import annotations

import itertools
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch
from ble_world import LONG_RUN, World
from host_process import START_S, host_process
from radio import (
    ATT_NOTIFICATION,
    ATT_WRITE_REQUEST,
    ATT_WRITE_RESPONSE,
    SUPERVISION_TIMEOUT_S,
    Fault,
)
from tensordict import TensorDictBase

from brickhub.hub.program import generate
from brickhub.hub.program.generate import WATCHDOG_MS
from brickhub.hub.transports.profile import CommandError, Event, PybricksCommand
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.envs.rollout import link_lost, play
from bricksrl.envs.task import Task
from bricksrl.errors import HubError
from bricktwin.robots import TWO_WHEELER

ATT_READ_REQUEST = 0x0A
STEPS = 3
CALL_BOUND_S = 12.0
RECOVERY_BOUND_S = 15.0
ADVERTISING_SLACK_S = 2.0
"""Timeout of hub threads."""
_PHASES = ("scan", "download", "start", "step", "reset", "close")
_KILLED = "host killed"
_TASK = Task(
    "Course-v0",
    "A wheel turns.",
    TWO_WHEELER,
    LONG_RUN,
    STEPS,
    reward=lambda before, action, after: after[..., :1] - before[..., :1],
    success=lambda observations: observations[..., 0].amax(-1) > 0,
    metrics=lambda observations: {},
)


@dataclass
class Report:
    """Observations of a course; it fails at the first violation.

    Attributes:
        longest_silent_drive_ms: longest motor run in silence (hub time) with the initial watchdog.
        longest_grown_drive_ms: the same with a watchdog that has grown with the link's delay.
        watchdog_ms: the longest watchdog.
        grown: faults with a grown watchdog.
    """

    faults: Counter[str] = field(default_factory=Counter)
    phases: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    transitions: int = 0
    longest_call_s: float = 0.0
    longest_recovery_s: float = 0.0
    longest_silent_drive_ms: int = 0
    longest_grown_drive_ms: int = 0
    grown: int = 0
    longest_until_advertising_s: float = 0.0
    watchdog_ms: int = WATCHDOG_MS


class CheckingLearner:
    """Replaces a learner in the rollout."""

    def __init__(self, world: World, rng: random.Random, report: Report) -> None:
        self._world, self._rng, self._report = world, rng, report
        self._run = 0
        self._last: torch.Tensor | None = None

    def policy(self, state: TensorDictBase) -> TensorDictBase:
        self._run = self._world.hub.runs
        return state.set("action", torch.tensor([self._rng.uniform(-1.0, 1.0)]))

    def remember(self, frame: TensorDictBase) -> None:
        assert self._world.hub.runs == self._run, "a transition reaches across a gap"
        assert self._last is None or torch.equal(frame["observation"], self._last), (
            "a transition reaches across a gap"
        )
        for observation in (frame["observation"], frame["next", "observation"]):
            left_deg, right_deg = observation.tolist()
            assert right_deg == 0 and 0 <= left_deg < 360, (
                "a motor that nobody moves has moved: a frame was decoded wrongly"
            )
        self._last = frame["next", "observation"]
        self._report.transitions += 1


class Course:
    """Faults on one hub."""

    def __init__(self, world: World, seed: int) -> None:
        self.world, self.rng = world, random.Random(seed)
        self.report = Report()
        self.link = world.link(LONG_RUN, timeout_s=4.0)
        self._watch_the_watchdog()
        connection = Connection(self.link, lambda _: None)
        self.env = HubEnv(_TASK, lambda _: connection, seed=seed)

    def _watch_the_watchdog(self) -> None:
        """Longest watchdog overall and since the last fault; a new program starts with the
        shortest."""
        told = self.link._set_watchdog
        self._in_force_ms = WATCHDOG_MS

        def tell(watchdog_ms: int) -> None:
            self._in_force_ms = max(self._in_force_ms, watchdog_ms)
            self.report.watchdog_ms = max(self.report.watchdog_ms, watchdog_ms)
            told(watchdog_ms)

        self.link._set_watchdog = tell  # type: ignore[method-assign]

    def run(self, faults: int) -> Report:
        self._train()
        for _ in range(faults):
            self._one_fault()
        self.env.close(raise_if_closed=False)
        return self.report

    def _one_fault(self) -> None:
        rng, world, report = self.rng, self.world, self.report
        phase = rng.choice(_PHASES)
        kinds = self._kinds(phase)
        kind = rng.choice([*kinds, _KILLED])
        report.phases[phase] += 1
        report.faults[kind] += 1
        if phase in ("scan", "download", "start") or kind == _KILLED:
            self.env.close(raise_if_closed=False)
            if phase == "download":
                world.hub.size = 0
        before_runs = world.hub.runs
        if kind == _KILLED:
            broken = self._kill_host(phase)
        else:
            kinds[kind]()
            broken = self._use(phase)
        world.fault(None)
        world.hub.faults.clear()
        world.radio.come_back()
        start_s = time.monotonic()
        if broken:
            world.hub.wait_until("is_driven", False, report.watchdog_ms / 1000 + 1.0)
        while not self._train():
            assert time.monotonic() - start_s < RECOVERY_BOUND_S, (
                f"no training again after {kind} in {phase}"
            )
        took_s = time.monotonic() - start_s
        report.longest_recovery_s = max(report.longest_recovery_s, took_s)
        assert took_s < RECOVERY_BOUND_S, (
            f"{took_s:.1f} s until training went on after {kind} in {phase}"
        )
        self._look_at_the_motors(f"{kind} in {phase}")
        assert world.hub.runs >= before_runs

    def _look_at_the_motors(self, fault: str) -> None:
        """Duration of motor runs in silence, by the hub's clock."""
        drive_ms, self.world.hub.longest_silent_drive_ms = self.world.hub.longest_silent_drive_ms, 0
        in_force_ms, self._in_force_ms = self._in_force_ms, self.link._watchdog_ms
        assert drive_ms <= in_force_ms, (
            f"motors ran on for {drive_ms} ms, {in_force_ms} ms allowed ({fault})"
        )
        report = self.report
        if in_force_ms == WATCHDOG_MS:
            report.longest_silent_drive_ms = max(report.longest_silent_drive_ms, drive_ms)
        else:
            report.longest_grown_drive_ms = max(report.longest_grown_drive_ms, drive_ms)
            report.grown += 1

    def _use(self, phase: str) -> bool:
        """Training in the phase. Returns whether it failed."""
        try:
            if phase == "close":
                self._timed(lambda: self.env.close(raise_if_closed=False))
                return False
            if phase == "reset":
                self._timed(self.env.reset)
                return False
        except HubError as error:
            self._note(error)
            return True
        return not self._train()

    def _train(self) -> bool:
        """One episode. Returns whether it was complete."""
        learner = CheckingLearner(self.world, self.rng, self.report)
        try:
            state = self._timed(self.env.reset)
        except HubError as error:
            self._note(error)
            return False
        length = 0
        for frame in play(self.env, learner.policy, state):
            if link_lost(frame):
                assert bool(frame["next", "truncated"]) and not bool(frame["next", "terminated"]), (
                    "a lost link ends nothing but the time"
                )
                assert self.env.link_error is not None
                self._note(self.env.link_error)
                return False
            learner.remember(frame)
            length += 1
        return length == STEPS

    def _note(self, error: HubError) -> None:
        assert "\n" not in str(error), "one line"
        self.report.errors[type(error).__name__] += 1

    def _timed(self, call: Callable[[], object]) -> object:
        start_s = time.monotonic()
        try:
            return call()
        finally:
            took_s = time.monotonic() - start_s
            self.report.longest_call_s = max(self.report.longest_call_s, took_s)
            assert took_s < CALL_BOUND_S, f"a call took {took_s:.1f} s"

    # ---- the faults

    def _kinds(self, phase: str) -> dict[str, Callable[[], object]]:
        world = self.world
        kinds: dict[str, Callable[[], object]] = {
            "lost notifications": lambda: world.fault(self._some((ATT_NOTIFICATION,), lambda _: 0)),
            "duplicated notifications": lambda: world.fault(
                self._some((ATT_NOTIFICATION,), lambda _: 2)
            ),
            "flipped bits": lambda: world.fault(self._flip()),
            "writes never acknowledged": lambda: world.fault(
                self._some((ATT_WRITE_RESPONSE,), lambda _: 0)
            ),
            "lost commands": lambda: world.fault(self._some((ATT_WRITE_REQUEST,), lambda _: 0)),
            "busy answers": lambda: self._refuse(CommandError.BUSY),
            "invalid answers": lambda: self._refuse(CommandError.INVALID_COMMAND),
            "disconnection": lambda: world.fault(self._cut(phase)),
            "out of reach": world.radio.leave,
        }
        if phase in ("step", "reset", "close"):
            kinds |= {
                "reboot": world.hub.reboot,
                "button": world.hub.press_button,
                "program raises": self._unplug,
            }
        return kinds

    def _some(self, opcodes: tuple[int, ...], result: Callable[[bytes], int | bytes]) -> Fault:
        """Apply to a third of the packets of some kinds."""
        return lambda opcode, data: (
            result(data) if opcode in opcodes and self.rng.random() < 1 / 3 else 1
        )

    def _flip(self) -> Fault:
        """Flip one bit in a third of the program's output."""

        def rule(opcode: int, data: bytes) -> int | bytes:
            is_output = (
                opcode == ATT_NOTIFICATION and len(data) > 4 and data[3] == Event.WRITE_STDOUT
            )
            if not is_output or self.rng.random() > 1 / 3:
                return 1
            place = self.rng.randrange(4, len(data))
            return (
                data[:place]
                + bytes((data[place] ^ 1 << self.rng.randrange(8),))
                + data[place + 1 :]
            )

        return rule

    def _kill_host(self, phase: str) -> bool:
        """Let another process drive the hub, and kill it at a packet of the phase."""
        # to subscribe looks like a first start
        count = self.rng.randrange(1, {"start": 3, "close": 2}.get(phase, 4))
        with host_process(
            self.world, 10, steps=6, says_good_bye=self.rng.random() < 0.5
        ) as process:
            self.world.fault(_at(phase, count, process.kill))
            process.wait(START_S)
            killed = 1 if sys.platform == "win32" else -signal.SIGKILL
            assert process.returncode == killed, f"the host ended with {process.returncode}"
        silence_s = SUPERVISION_TIMEOUT_S + (self.report.watchdog_ms + generate.END_MS) / 1000
        took_s = self.world.hub.wait_until("is_advertising", True, silence_s + ADVERTISING_SLACK_S)
        self.report.longest_until_advertising_s = max(
            self.report.longest_until_advertising_s, took_s
        )
        return True

    def _cut(self, phase: str) -> Fault:
        """Break the link at a packet of the phase."""
        return _at(phase, self.rng.randrange(1, 4), self.world.radio.disconnect)

    def _refuse(self, code: CommandError) -> None:
        self.world.hub.faults[self.rng.choice(list(PybricksCommand))] = [code] * self.rng.choice(
            [1, 3, 100]
        )

    def _unplug(self) -> None:
        """Unplug and replug a motor: the next command to it raises."""
        self.world.hub.machine.servos["E"].close()


def _at(phase: str, count: int, harm: Callable[[], object]) -> Fault:
    """Inject a fault at the count-th packet of the phase, which is lost."""
    wanted = {
        "scan": (ATT_READ_REQUEST, None),
        "download": (ATT_WRITE_REQUEST, PybricksCommand.WRITE_USER_RAM),
        "start": (ATT_WRITE_REQUEST, PybricksCommand.START_USER_PROGRAM),
        "close": (ATT_WRITE_REQUEST, PybricksCommand.STOP_USER_PROGRAM),
    }.get(phase, (ATT_WRITE_REQUEST, PybricksCommand.WRITE_STDIN))
    left = itertools.count(count, -1)

    def rule(opcode: int, data: bytes) -> int:
        command = data[3] if len(data) > 3 else None
        if opcode == wanted[0] and wanted[1] in (None, command) and next(left) == 1:
            harm()
            return 0
        return 1

    return rule


def run_course(folder: Path, faults: int, seed: int) -> Report:
    """A hub with a number of faults."""
    world = World(folder)
    try:
        return Course(world, seed).run(faults)
    finally:
        world.close()
