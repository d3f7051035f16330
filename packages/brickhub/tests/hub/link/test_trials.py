"""Trials that a hub makes by itself: the generated program in the virtual hub, over links with
faults."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace

import pytest
from described import REACHING, ROBO_ARM, RUN_AWAY, TWO_WHEELER, WALKER, WALKING

from brickhub.entry import Entry
from brickhub.errors import HubError, HubTimeoutError, SilentHubError, StoppedError
from brickhub.hub.interface import (
    Interface,
    MotorAngle,
    RunAngle,
    RunSpeed,
    UntilDone,
    Wait,
    WheelsAngle,
    WheelsSpeed,
)
from brickhub.hub.link.profiles import PROFILES
from brickhub.hub.link.states import LinkState
from brickhub.hub.link.trial_link import TrialLink
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.protocol import EncodingError
from brickhub.hub.transport import Pipe
from brickhub.hub.trial_protocol import TrialWire
from brickhub.robot import HubKind, Motor, Robot
from brickhub.search.bayesian_search import structure_for
from brickhub.search.structure import source_by
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

STILL_MDEG = 3000
"""Motors coast a little when they are stopped."""


class Hub(VirtualHub):
    """A virtual hub whose writes may be lost or repeated, and whose notifications may be lost."""

    def __init__(self, robot: Robot, **options: object) -> None:
        super().__init__(BenchBody(robot), **options)
        self.fates = itertools.repeat(1)
        self.loses = itertools.repeat(False)
        self.tilt = (0.0, 0.0)
        self.body.tilt_deg = lambda: self.tilt

    def write(self, data: bytes) -> None:
        for _ in range(next(self.fates)):
            super().write(data)

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        return b"" if data and next(self.loses) else data

    def turned_mdeg(self, ms: int) -> int:
        """How far its motors turn in a time."""
        before = [self.body.angle_mdeg(motor.port) for motor in self.robot.motors]
        self.run_on_until(self.machine.time_ms + ms)
        after = [self.body.angle_mdeg(motor.port) for motor in self.robot.motors]
        return max(abs(one - other) for one, other in zip(before, after, strict=True))


def linked(
    robot: Robot = WALKER, interface: Interface = WALKING, **options: object
) -> tuple[Hub, TrialLink]:
    structure = structure_for(robot, interface)
    hub = Hub(robot, **{name: options.pop(name) for name in ("link", "seed") if name in options})
    link = TrialLink(hub, robot, interface, structure.numbers, structure.hub_source(), **options)
    return hub, link


NUMBERS = (-0.5, 180.0, 90.0, 200.0)
"""Of a Walker whose mirrored pairs are not described."""


@pytest.mark.parametrize("pipe", list(Pipe))
def test_a_trial_acts_as_the_structure_does_and_reports_each_step(pipe: Pipe) -> None:
    slowly = replace(WALKING, settle=Wait(500))
    hub, link = linked(WALKER, slowly, pipe=pipe)
    structure = structure_for(WALKER, slowly)
    with link:
        readings = link.make_trial(NUMBERS, 6)
        assert readings is not None and len(readings) == 7
        assert link.state is LinkState.READY and link.writes == 1
        assert hub.turned_mdeg(500) < STILL_MDEG, "the motors stand after a trial"
    times = [reading.hub_time_ms for reading in readings]
    assert all(
        after - before == pytest.approx(500, abs=8) for before, after in itertools.pairwise(times)
    )
    for before, after in itertools.pairwise(readings):
        wanted = structure.act(before.values, NUMBERS)
        for index, action in enumerate(wanted):
            turned = (after.values[index] - before.values[index] + 180.0) % 360.0 - 180.0
            # the command is of -100 to 0 degrees
            assert turned == pytest.approx(50.0 * (action - 1.0), abs=2.0)


ARM = Robot("arm", HubKind.CITY, motors=(Motor("low", "A"), Motor("high", "B")))
TURNING = Interface(
    tuple(RunAngle(motor.name, -60, 60, 400) for motor in ARM.motors),
    tuple(MotorAngle(motor.name) for motor in ARM.motors),
    UntilDone(800),
)


@pytest.mark.parametrize(
    ("robot", "interface", "pieces"),
    [(WALKER, WALKING, 1), (TWO_WHEELER, RUN_AWAY, 2), (ROBO_ARM, REACHING, 4), (ARM, TURNING, 1)],
)
def test_programs_are_small_and_run_on_every_hub(
    robot: Robot, interface: Interface, pieces: int
) -> None:
    hub, link = linked(robot, interface)
    assert len(program_blob(compile_program(link.program), robot.hub)) < 6144
    assert max(map(len, link.program.source.splitlines())) <= 130
    assert link.trial_wire.pieces == pieces
    middle = [(entry.low + entry.high) / 2 for entry in link.trial_wire.numbers]
    with link:
        readings = link.make_trial(middle, 3)
    assert readings is not None and len(readings) == 4
    assert hub.radio is not None


@pytest.mark.parametrize("seed", range(6))
def test_lost_and_repeated_writes_make_each_trial_once(seed: int) -> None:
    rng = random.Random(seed)
    hub, link = linked(link=PROFILES["linux"], seed=seed)
    with link:
        hub.fates = iter(lambda: rng.choice([0, 1, 1, 2]), None)
        for steps in (1, 3, 2):
            started_ms = hub.machine.time_ms
            readings = link.make_trial(NUMBERS, steps)
            assert readings is not None and len(readings) == steps + 1
            # twice would take twice as long
            last_ms = readings[-1].hub_time_ms - readings[0].hub_time_ms
            assert last_ms == pytest.approx(250 * steps, abs=30)
            assert hub.machine.time_ms - started_ms < 250 * steps + 5000


@pytest.mark.parametrize("seed", range(6))
def test_a_lost_observation_loses_its_trial_alone(seed: int) -> None:
    rng = random.Random(seed)
    hub, link = linked(link=PROFILES["mac"], seed=seed)
    outcomes = []
    with link:
        hub.loses = iter(lambda: rng.random() < 0.15, None)
        for _ in range(6):
            readings = link.make_trial(NUMBERS, 4)
            outcomes.append(readings)
            assert readings is None or len(readings) == 5
            assert hub.turned_mdeg(300) < STILL_MDEG
        hub.loses = itertools.repeat(False)
        assert link.make_trial(NUMBERS, 4) is not None
    assert any(outcomes)


def test_an_older_request_that_comes_late_is_not_made_again() -> None:
    hub, link = linked()
    wire = link.trial_wire
    with link:
        link.make_trial(NUMBERS, 2)
        link.make_trial(NUMBERS, 2)
        for frame in wire.request(1, NUMBERS, 5):
            hub.write(frame)
        assert hub.turned_mdeg(1000) < STILL_MDEG
        assert link.make_trial(NUMBERS, 1) is not None


def test_the_host_may_be_silent_within_a_trial_and_the_motors_stand_after_it() -> None:
    hub, link = linked()
    with link:
        for frame in link.trial_wire.request(1, NUMBERS, 8):
            hub.write(frame)
        assert hub.turned_mdeg(1500) > 100_000
        hub.run_on_until(hub.machine.time_ms + 1000)
        assert hub.turned_mdeg(7000) < STILL_MDEG
        assert link.read().values, "the program is still there"


def test_no_trial_is_longer_than_ten_seconds() -> None:
    _, link = linked(timeout_s=80.0)
    with link:
        readings = link.make_trial(NUMBERS, 255)
    assert readings is not None
    assert readings[-1].hub_time_ms - readings[0].hub_time_ms == pytest.approx(10_000, abs=300)


def test_silence_between_trials_ends_the_program() -> None:
    hub, link = linked()
    with link:
        link.make_trial(NUMBERS, 1)
        hub.run_on_until(hub.machine.time_ms + 9_000)
        link.read()
        hub.run_on_until(hub.machine.time_ms + 10_500)
        with pytest.raises(SilentHubError, match="it had not heard from this computer"):
            link.make_trial(NUMBERS, 1)
        link.open()
        assert link.make_trial(NUMBERS, 1) is not None


def test_a_tilt_ends_a_trial_at_once() -> None:
    hub, link = linked()
    with link:
        hub.tilt = (0.0, -36.0)
        readings = link.make_trial(NUMBERS, 8)
        assert readings is not None and len(readings) == 1
        assert readings[0].values[5] == -36.0
        assert hub.turned_mdeg(500) < STILL_MDEG


@pytest.mark.parametrize("way", ["stop", "rest", "emergency_stop"])
def test_motors_stop_within_a_trial(way: str) -> None:
    hub, link = linked()
    with link:
        for frame in link.trial_wire.request(1, NUMBERS, 20):
            hub.write(frame)
        hub.run_on_until(hub.machine.time_ms + 600)
        getattr(link, way)()
        hub.run_on_until(hub.machine.time_ms + 300)
        assert hub.turned_mdeg(1000) < STILL_MDEG
        if way == "emergency_stop":
            with pytest.raises(StoppedError):
                link.make_trial(NUMBERS, 1)
            link.release()
        link.open()
        assert link.make_trial(NUMBERS, 2) is not None


def test_a_link_that_breaks_within_a_trial_leaves_the_motors_standing_after_it() -> None:
    hub, link = linked()
    with link:
        ends_ms = hub.machine.time_ms + 700
        hub.in_reach = lambda: hub.machine.time_ms < ends_ms
        with pytest.raises(HubError, match="out of reach"):
            link.make_trial(NUMBERS, 8)
        hub.run_on_until(hub.machine.time_ms + 2_500)
        assert hub.turned_mdeg(2_000) < STILL_MDEG
        hub.in_reach = lambda: True
        link.open()
        assert link.make_trial(NUMBERS, 1) is not None


def test_a_hub_that_says_nothing_is_a_timeout_and_not_a_hang() -> None:
    hub, link = linked(timeout_s=2.0)
    with link:
        hub.loses = itertools.repeat(True)
        with pytest.raises(HubTimeoutError, match="the hub did not end its trial within"):
            link.make_trial(NUMBERS, 2)


def test_what_fits_no_frame_is_refused_before_anything_is_sent() -> None:
    _, link = linked()
    with link:
        for numbers, steps, said in (
            (NUMBERS, 0, "a trial of 0 steps; give 1 to 255"),
            (NUMBERS[:3], 2, "got 3 numbers for a trial; give 4"),
            ((-2.0, *NUMBERS[1:]), 2, "'speed' is -2.0; give -1 to 1"),
        ):
            with pytest.raises(EncodingError, match=said):
                link.make_trial(numbers, steps)
        assert link.writes == 0 and link.state is LinkState.READY
        with pytest.raises(HubError, match="acts by itself"):
            link.act([0.0] * 4)


def test_every_write_and_notification_of_a_trial_fits() -> None:
    for count in (1, 7, 8, 20):
        entries = [Entry(f"n{index}", -2.0, 3.0) for index in range(count)]
        frames = TrialWire(WALKING, WALKER, entries).request(255, [0.5] * count, 255)
        assert all(len(frame) <= 20 for frame in frames)
        assert len(frames) == -(-count // 7)
    assert TrialWire(WALKING, WALKER, entries).answers.answer_bytes + 3 <= 19


def test_a_program_of_its_own_acts_by_the_same_formula() -> None:
    source = source_by(structure_for(WALKER, WALKING), NUMBERS)
    assert "NUMBERS = (-0.5, 180, 90, 200,)" in source


def test_steps_of_a_trial_come_one_at_a_time_and_the_next_trial_follows() -> None:
    hub, link = linked(link=PROFILES["mac"], seed=1)
    with link:
        first = [link.step(NUMBERS, 3) for _ in range(3)]
        assert link.writes == 1 and link.state is LinkState.READY
        assert hub.turned_mdeg(500) < STILL_MDEG, "the motors stand after the last step"
        then = [link.step(NUMBERS, 2) for _ in range(2)]
        assert link.writes == 2
    times_ms = [reading.hub_time_ms for reading in first]
    assert times_ms[2] - times_ms[0] == pytest.approx(500, abs=20)
    assert then[0].hub_time_ms - times_ms[2] > 500


def test_reading_within_a_trial_ends_it() -> None:
    hub, link = linked()
    with link:
        link.step(NUMBERS, 20)
        assert hub.turned_mdeg(200) > 20_000
        link.read()
        assert hub.turned_mdeg(800) < STILL_MDEG
        link.step(NUMBERS, 2)
        assert link.writes == 2, "the next step is that of a new trial"


def test_a_trial_that_tilts_has_no_further_steps() -> None:
    hub, link = linked()
    with link:
        link.step(NUMBERS, 8)
        hub.tilt = (40.0, 0.0)
        assert link.step(NUMBERS, 8).values[4] == 40.0
        assert link.step(NUMBERS, 8).values[4] == 40.0
        assert link.writes == 2
        assert hub.turned_mdeg(500) < STILL_MDEG


def test_a_lost_observation_is_an_error_of_its_trial() -> None:
    hub, link = linked()
    with link:
        link.step(NUMBERS, 4)
        lost = iter([True])
        hub.loses = iter(lambda: next(lost, False), None)
        for _ in range(2):
            link.step(NUMBERS, 4)
        with pytest.raises(HubTimeoutError, match="an observation of a trial was lost"):
            link.step(NUMBERS, 4)
        assert link.step(NUMBERS, 4).values


def test_what_counts_on_is_read_from_the_start_of_each_trial() -> None:
    robot = Robot(
        "cart",
        HubKind.PRIME,
        motors=(Motor("left", "A"), Motor("right", "B")),
    )
    interface = Interface(
        (RunSpeed("left", -360, 360), RunSpeed("right", -360, 360)),
        (WheelsAngle("left", "right"), WheelsSpeed("left", "right")),
        Wait(100),
    )
    # Both turn until they have turned by the number, and back from what is beyond it.
    policy = "def act_by(observed, numbers):\n    return [(numbers[0] - observed[0]) / 100] * 2\n"
    link = TrialLink(Hub(robot), robot, interface, [Entry("turn", 0.0, 360.0)], policy)
    with link:
        for number in range(1, 3):
            readings = link.make_trial([90.0], 20)
            assert readings is not None
            assert readings[-1].values[0] == pytest.approx(90.0 * number, abs=8.0)


def test_other_numbers_replace_the_trial_that_goes_on() -> None:
    _, link = linked()
    with link:
        first = [link.step(NUMBERS, 20) for _ in range(2)]
        then = [link.step((1.0, *NUMBERS[1:]), 3) for _ in range(3)]
        assert link.writes == 2 and link.state is LinkState.READY
    turned = [(before.values[0] - after.values[0]) % 360.0 for before, after in (first, then[-2:])]
    assert turned[1] < turned[0] - 30.0, "it is the slower one"
