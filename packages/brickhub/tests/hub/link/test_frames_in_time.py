"""Which frames a link writes, and when, to a hub that answers as a test says."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from described import TWO_WHEELER

from brickhub.entry import Entry
from brickhub.errors import (
    HubDisconnectedError,
    HubError,
    HubProgramError,
    HubTimeoutError,
    SilentHubError,
)
from brickhub.hub.interface import (
    Interface,
    MotorAngle,
    Pitch,
    RemoteButton,
    RunAngle,
    RunSpeed,
    UntilDone,
    Wait,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.states import LinkState
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.link.trial_link import TrialLink
from brickhub.hub.protocol import control_frame, crc8, data_frame, hello_payload
from brickhub.hub.transport import HubProgram, Pipe

INTERFACE = Interface((RunAngle("left", -90, 90, 300),), (MotorAngle("left"),), Wait(100))
Answers = Callable[[bytes], list[tuple[float, bytes]]]


def nothing(frame: bytes) -> list[tuple[float, bytes]]:
    """A hub that does not answer."""
    return []


class ScriptedHub:
    """A transport in simulated time. ``answers``: to each frame, what comes after which time;
    ``write_s``: how long a write takes."""

    def __init__(self, answers: Answers = nothing, *, says_hello: bool = True) -> None:
        self.answers = answers
        self.says_hello = says_hello
        self.write_s = 0.0
        self.clock_s = 10.0
        self.written: list[tuple[float, bytes]] = []
        self.starts = 0
        self.stops = 0
        self.fails: HubError | None = None
        self._coming: list[tuple[float, bytes]] = []

    def open(self) -> None: ...

    def close(self) -> None: ...

    def stop(self) -> None:
        self.stops += 1

    def start(self, program: HubProgram) -> None:
        self.starts += 1
        self._coming.clear()
        self.hello = control_frame(ord("H"), hello_payload(program.hash))
        if self.says_hello:
            self._coming.append((self.clock_s, self.hello))

    def now_s(self) -> float:
        return self.clock_s

    def write(self, data: bytes) -> None:
        self.clock_s += self.write_s
        self.written.append((self.clock_s, data))
        for delay_s, answer in self.answers(data):
            self._coming.append((self.clock_s + delay_s, answer))
        self._coming.sort(key=lambda one: one[0])

    def read(self, timeout_s: float) -> bytes:
        if self.fails is not None:
            raise self.fails
        if self._coming and self._coming[0][0] <= self.clock_s + timeout_s:
            due_s, data = self._coming.pop(0)
            self.clock_s = max(self.clock_s, due_s)
            return data
        self.clock_s += timeout_s
        return b""

    def told(self, since_s: float = 10.0) -> list[tuple[float, str]]:
        """When it was told what: a letter for a control frame, ``#`` and a number for data."""
        told = []
        for time_s, data in self.written:
            assert crc8(data) == 0
            what = f"#{data[1]}" if data[1] else chr(data[2])
            told.append((round(time_s - since_s, 4), what))
        return told


def answer_of(seq: int, time_ms: int = 0, angle: int = 0) -> bytes:
    """An answer of the hub: its clock, and an angle in tenths."""
    return data_frame(seq, struct.pack("<Hh", time_ms, angle))


def promptly(frame: bytes) -> list[tuple[float, bytes]]:
    """Answers of a hub that does what it is told: a step takes 0.1 s."""
    if frame[1]:
        return [(0.1, answer_of(frame[1], angle=123))]
    if frame[2] == ord("R"):
        return [(0.01, answer_of(frame[3], angle=456))]
    return []


def linked(hub: ScriptedHub, interface: Interface = INTERFACE, **options: Any) -> HubLink:
    """An open link; what was written before is forgotten."""
    link = HubLink(hub, TWO_WHEELER, interface, **options)  # type: ignore[arg-type]
    link.open()
    hub.written.clear()
    return link


def test_hello_is_waited_for_four_times() -> None:
    hub = ScriptedHub(says_hello=False)
    link = HubLink(hub, TWO_WHEELER, INTERFACE, timeout_s=2.0)  # type: ignore[arg-type]
    with pytest.raises(HubTimeoutError, match="the program did not say hello within 2 s; check"):
        link.open()
    assert hub.told() == [(0.5, "H"), (1.0, "H"), (1.5, "H")]
    assert hub.clock_s == pytest.approx(12.0)
    assert link.state is LinkState.FAULT


def test_remote_gives_a_program_ten_more_seconds() -> None:
    hub = ScriptedHub(says_hello=False)
    interface = replace(INTERFACE, channels=(*INTERFACE.channels, RemoteButton("left")))
    link = HubLink(hub, TWO_WHEELER, interface, timeout_s=2.0)  # type: ignore[arg-type]
    with pytest.raises(HubTimeoutError, match="did not say hello within 12 s"):
        link.open()
    assert [time_s for time_s, _ in hub.told()] == [3.0, 6.0, 9.0]


def test_hello_that_was_lost_is_asked_for() -> None:
    asked = 0

    def second_time(frame: bytes) -> list[tuple[float, bytes]]:
        nonlocal asked
        asked += 1
        return [(0.1, hub.hello)] if asked == 2 else []

    hub = ScriptedHub(second_time, says_hello=False)
    link = HubLink(hub, TWO_WHEELER, INTERFACE, timeout_s=2.0)  # type: ignore[arg-type]
    link.open()
    assert hub.told() == [(0.5, "H"), (1.0, "H")]
    assert link.state is LinkState.READY


def test_step_that_is_not_answered() -> None:
    hub = ScriptedHub()
    link = linked(hub, timeout_s=0.95)
    with pytest.raises(HubTimeoutError, match="the hub did not answer within 1.05 s; check that"):
        link.act([5])
    # An answer is overdue after half of the watchdog's time.
    assert hub.told() == [(time_s, "#1") for time_s in (0.0, 0.3, 0.5, 0.7, 0.9)]
    assert hub.clock_s == pytest.approx(11.05)
    assert link.statistics.resends == 4
    assert link.state is LinkState.FAULT


def test_long_step_has_keepalives_of_which_each_sixth_is_the_command() -> None:
    hub = ScriptedHub(
        lambda frame: [(0.95, answer_of(1))] if frame[1] and len(hub.written) == 1 else []
    )
    link = linked(hub, replace(INTERFACE, settle=Wait(950)), timeout_s=1.0)
    reading = link.act([5])
    pause_s = 0.95 / 15
    kinds = ["#1", "#1", *"WWWWW", "#1", *"WWWWW", "#1", "W"]
    wanted = [(round(number * pause_s, 4), kind) for number, kind in enumerate(kinds)]
    assert hub.told() == wanted
    watchdog = control_frame(ord("W"), struct.pack("<H", 400))
    assert hub.written[2][1] == watchdog
    assert (link.statistics.resends, link.statistics.stale_answers) == (0, 0)
    assert reading.round_trip_s == pytest.approx(0.95)


def test_step_until_done_is_overdue_after_its_longest_time() -> None:
    hub = ScriptedHub()
    link = linked(hub, replace(INTERFACE, settle=UntilDone(200)), timeout_s=0.3)
    with pytest.raises(HubTimeoutError, match="within 0.5 s"):
        link.act([5])
    # Six within the watchdog's time, and after 0.2 s the command each time.
    pause_s = 0.4 / 6
    kinds = ["#1", "#1", "W", "W", "#1", "#1", "#1", "#1"]
    assert [kind for _, kind in hub.told()] == kinds
    times_s = [time_s for time_s, _ in hub.told()]
    assert times_s == pytest.approx([number * pause_s for number in range(8)], abs=1e-3)
    assert link.statistics.resends in (4, 5)


def test_reading_asks_by_its_number_and_is_overdue_at_half_of_the_watchdog() -> None:
    hub = ScriptedHub(promptly)
    link = linked(hub)
    assert link.act([5]).values == (pytest.approx(12.3),)
    reading = link.read()
    assert reading.values == (pytest.approx(45.6),)
    assert reading.round_trip_s == pytest.approx(0.01)
    assert [data for _, data in hub.written][1] == control_frame(ord("R"), b"\x02")
    hub.answers = nothing
    hub.written.clear()
    began_s = hub.clock_s
    with pytest.raises(HubTimeoutError, match="within 5 s"):
        link.read()
    assert hub.told(began_s)[:3] == [(0.0, "R"), (0.2, "R"), (0.4, "R")]


@pytest.mark.parametrize(
    ("write_s", "watchdog_ms"), [(0.09, None), (0.099, None), (0.12, 480), (20.0, 65_535)]
)
def test_watchdog_is_four_times_a_slow_write(write_s: float, watchdog_ms: int | None) -> None:
    hub = ScriptedHub(promptly)
    link = linked(hub, timeout_s=60.0)
    link.act([1])
    hub.write_s = write_s
    link.act([1])
    hub.written.clear()
    link.act([1])
    first = hub.written[0][1]
    if watchdog_ms is None:
        assert first[1] == 3
        assert link.statistics.watchdog_s == 0.4
        return
    assert first == control_frame(ord("W"), struct.pack("<H", watchdog_ms))
    assert hub.written[1][1][1] == 3
    assert link.statistics.watchdog_s == watchdog_ms / 1000


def test_write_after_a_pause_says_nothing_of_the_link() -> None:
    hub = ScriptedHub(promptly)
    link = linked(hub)
    hub.write_s = 0.2
    hub.clock_s += 0.5
    link.act([1])
    assert list(link.statistics.delays_s) == []
    link.act([1])
    assert list(link.statistics.delays_s) == [pytest.approx(0.2)]


@pytest.mark.parametrize(
    ("watchdog_s", "told"), [(0.4, []), (0.6, [600]), (0.1, [100]), (99.0, [65_535])]
)
def test_watchdog_that_is_asked_for(watchdog_s: float, told: list[int]) -> None:
    hub = ScriptedHub(promptly)
    link = HubLink(hub, TWO_WHEELER, INTERFACE, watchdog_s=watchdog_s)  # type: ignore[arg-type]
    link.open()
    frames = [control_frame(ord("W"), struct.pack("<H", time_ms)) for time_ms in told]
    assert [data for _, data in hub.written] == frames


def test_rest_stops_the_motors_and_counts_anew() -> None:
    def answers(frame: bytes) -> list[tuple[float, bytes]]:
        return [(0.01, hub.hello)] if frame[1] == 0 and frame[2] == ord("H") else promptly(frame)

    hub = ScriptedHub(answers)
    link = linked(hub)
    link.act([1])
    link.act([1])
    assert link.state is LinkState.ARMED
    link.rest()
    assert link.state is LinkState.READY
    link.act([1])
    assert [what for _, what in hub.told()] == ["#1", "#2", "H", "#1"]


def test_answers_to_other_numbers_are_stale() -> None:
    hub = ScriptedHub(lambda frame: [(0.0, answer_of(9)), (0.1, answer_of(frame[1], angle=77))])
    link = linked(hub)
    assert link.act([1]).values == (pytest.approx(7.7),)
    assert (link.statistics.stale_answers, link.statistics.exchanges) == (1, 1)


BYE = control_frame(ord("B"), b"\x02")


def test_program_that_ended_by_itself_is_started_by_a_reading_only() -> None:
    hub = ScriptedHub(lambda frame: [(0.0, BYE)])
    link = linked(hub)
    with pytest.raises(SilentHubError, match="not heard from this computer for too long"):
        link.act([1])
    assert link.state is LinkState.FAULT
    link.open()
    assert hub.starts == 2

    def once(frame: bytes) -> list[tuple[float, bytes]]:
        hub.answers = promptly
        return [(0.0, BYE)]

    hub.answers = once
    assert link.read().values == (pytest.approx(45.6),)
    assert hub.starts == 3


def test_reason_of_the_program_goes_before_that_of_the_transport() -> None:
    hub = ScriptedHub()
    link = linked(hub)
    pieces = [b"", BYE]

    def read(timeout_s: float) -> bytes:
        if len(pieces) == 2:
            pieces.pop(0)
            raise HubDisconnectedError("out of reach")
        return pieces.pop(0)

    hub.read = read  # type: ignore[method-assign]
    with pytest.raises(SilentHubError):
        link.act([1])


def test_transport_that_fails_says_why() -> None:
    hub = ScriptedHub()
    link = linked(hub)
    hub.fails = HubDisconnectedError("out of reach")
    with pytest.raises(HubDisconnectedError, match="out of reach"):
        link.act([1])
    assert link.state is LinkState.FAULT


def test_traceback_is_read_to_its_end() -> None:
    lines = [
        b"Traceback (most recent call last):\r\n",
        b'  File "main.py", line 1, in <module>\r\n',
        b"OSError: [Errno 19] ENODEV\r\n",
    ]
    hub = ScriptedHub(lambda frame: [(0.15 * number, line) for number, line in enumerate(lines)])
    link = linked(hub)
    says = r"the program on the hub raised OSError: \[Errno 19\] ENODEV at line 1 \(# Program of"
    with pytest.raises(HubProgramError, match=says):
        link.act([1])


def test_what_the_program_prints_is_in_the_message_of_a_timeout() -> None:
    hub = ScriptedHub(lambda frame: [(0.0, b"first\r\nhot\r\n")])
    link = linked(hub, timeout_s=0.5)
    with pytest.raises(HubTimeoutError, match=r"within 0.6 s \(it printed: hot\); check that"):
        link.act([1])
    assert link.statistics.skipped_bytes > 0


STREAMED = Interface((RunSpeed("left", -90, 90),), (MotorAngle("left"),), Wait(100))


def streaming(hub: ScriptedHub, **options: Any) -> StreamingLink:
    """An open streaming link."""
    link = StreamingLink(hub, TWO_WHEELER, STREAMED, **options)  # type: ignore[arg-type]
    link.open()
    return link


def test_streaming_hub_is_asked_for_observations_each_ten_milliseconds() -> None:
    hub = ScriptedHub()
    streaming(hub)
    assert [data for _, data in hub.written] == [control_frame(ord("T"), b"\x0a\x00")]


def stream(frame: bytes) -> list[tuple[float, bytes]]:
    """Observations each 30 ms under a command."""
    if not frame[1]:
        return []
    return [(0.03 * k, answer_of(frame[1], angle=k)) for k in range(1, 6)]


def test_step_of_a_stream_ends_in_its_time_with_the_newest_observation() -> None:
    hub = ScriptedHub(stream)
    link = streaming(hub)
    hub.written.clear()
    began_s = hub.clock_s
    first = link.act([1])
    assert hub.clock_s - began_s == pytest.approx(0.1, abs=1e-3)
    # Those after 30, 60 and 90 ms had come.
    assert first.values == (pytest.approx(0.3),)
    assert first.round_trip_s == pytest.approx(0.03)
    # The caller's own time does not add up.
    hub.clock_s += 0.04
    link.act([1])
    assert hub.clock_s - began_s == pytest.approx(0.2, abs=1e-3)
    assert hub.told(began_s) == [(0.0, "#1"), (0.14, "#2")]
    # Who is late begins anew.
    hub.clock_s += 0.25
    late_s = hub.clock_s
    link.act([1])
    assert hub.clock_s - late_s == pytest.approx(0.1, abs=1e-3)
    assert link.statistics.exchanges == 3
    assert link.statistics.resends == 0


def test_stream_without_an_observation_is_asked_for_again() -> None:
    hub = ScriptedHub()
    link = streaming(hub, timeout_s=0.3)
    hub.written.clear()
    began_s = hub.clock_s
    with pytest.raises(HubTimeoutError, match="the hub sent no observation within 0.4 s; check"):
        link.act([1])
    third_s = 0.1333
    wanted = [(0.0, "#1")]
    for k in (1, 2):
        wanted += [(k * third_s, "T"), (k * third_s, "#1")]
    told = [(pytest.approx(time_s, abs=2e-3), what) for time_s, what in wanted]
    assert hub.told(began_s)[:5] == told
    assert link.statistics.resends in (2, 3)


NUMBERS = (Entry("speed", -1.0, 1.0), Entry("phase", 0.0, 360.0))
POLICY = "def act_by(observed, numbers):\n    return [0.0]\n"


def trying(hub: ScriptedHub, **options: Any) -> TrialLink:
    """An open link to a hub that makes trials by itself."""
    link = TrialLink(hub, TWO_WHEELER, INTERFACE, NUMBERS, POLICY, **options)  # type: ignore[arg-type]
    link.open()
    hub.written.clear()
    return link


def end_of(seq: int, count: int) -> bytes:
    return control_frame(ord("E"), struct.pack("<BH", seq, count))


def a_trial(frame: bytes) -> list[tuple[float, bytes]]:
    """A trial of two steps of 100 ms."""
    if not frame[1]:
        return []
    seq = frame[1]
    observed = [(0.1 * k, answer_of(seq, 100 * k, 10 * k)) for k in range(3)]
    return [*observed, (0.21, end_of(seq, 3))]


def test_trial_is_asked_for_once_and_read_to_its_end() -> None:
    hub = ScriptedHub(a_trial)
    link = trying(hub)
    readings = link.make_trial([0.5, 90.0], 2)
    assert readings is not None
    assert [reading.values for reading in readings] == [
        (0.0,),
        (1.0,),
        (2.0,),
    ]
    assert [reading.hub_time_ms for reading in readings] == [0, 100, 200]
    assert (link.writes, len(hub.written)) == (1, 1)
    assert link.state is LinkState.READY
    with pytest.raises(HubError, match="this hub acts by itself; use make_trial"):
        link.act([1])


def test_trial_that_nothing_comes_of_is_asked_for_again_and_given_up() -> None:
    hub = ScriptedHub()
    link = trying(hub, timeout_s=1.0)
    began_s = hub.clock_s
    with pytest.raises(HubTimeoutError, match="the hub did not end its trial within 1.2 s"):
        link.make_trial([0.5, 90.0], 2)
    assert hub.told(began_s) == [(0.0, "#1"), (0.4, "#1"), (0.8, "#1")]
    assert link.writes == 3


def test_end_of_a_trial_that_is_overdue_is_asked_for() -> None:
    def without_end(frame: bytes) -> list[tuple[float, bytes]]:
        if len(hub.written) == 1:
            return a_trial(frame)[:-1]
        return [(0.0, end_of(frame[1], 3))]

    hub = ScriptedHub(without_end)
    link = trying(hub)
    began_s = hub.clock_s
    readings = link.make_trial([0.5, 90.0], 2)
    assert readings is not None
    # The last observation came after 0.2 s; a step and half a second later it is asked.
    assert hub.told(began_s) == [(0.0, "#1"), (0.8, "#1")]


def test_trial_of_which_something_was_lost_is_none() -> None:
    def lossy(frame: bytes) -> list[tuple[float, bytes]]:
        whole = a_trial(frame)
        return [whole[0], whole[2], whole[3]]

    hub = ScriptedHub(lossy)
    link = trying(hub)
    assert link.make_trial([0.5, 90.0], 2) is None


def test_steps_of_a_trial_one_by_one() -> None:
    hub = ScriptedHub(a_trial)
    link = trying(hub)
    numbers = (0.5, 90.0)
    # The first observation is that before the first step.
    assert link.step(numbers, 2).values == (1.0,)
    assert link.step(numbers, 2).values == (2.0,)
    assert link.writes == 1
    assert link.step(numbers, 2).values == (1.0,)
    assert link.writes == 2
    # Other numbers begin another trial.
    assert link.step((0.6, 90.0), 2).values == (1.0,)
    assert link.writes == 3


def test_lost_step_of_a_trial_is_told() -> None:
    def lossy(frame: bytes) -> list[tuple[float, bytes]]:
        whole = a_trial(frame)
        return [whole[0], whole[1], whole[3]]

    hub = ScriptedHub(lossy)
    link = trying(hub)
    assert link.step((0.5, 90.0), 2).values == (1.0,)
    with pytest.raises(HubTimeoutError, match="an observation of a trial was lost; make the trial"):
        link.step((0.5, 90.0), 2)


def test_late_hello_is_no_answer_and_nothing_is_repeated_for_it() -> None:
    hub = ScriptedHub(lambda frame: [(0.02, hub.hello), (0.1, answer_of(1, angle=55))])
    link = linked(hub)
    assert link.act([1]).values == (pytest.approx(5.5),)
    assert hub.told() == [(0.0, "#1")]
    assert (link.statistics.resends, link.statistics.stale_answers) == (0, 0)


def test_calibrated_description_is_that_of_the_program() -> None:
    seen = []

    def calibrate(robot: Any) -> Any:
        seen.append(robot)
        left, right = robot.motors
        return replace(robot, motors=(replace(left, zero_deg=30), right))

    hub = ScriptedHub(promptly)
    link = HubLink(hub, TWO_WHEELER, INTERFACE, calibrate=calibrate)  # type: ignore[arg-type]
    assert "reset_angle" not in link.program.source
    link.open()
    assert seen == [TWO_WHEELER]
    assert "motor_left.reset_angle(" in link.program.source
    link.stop()
    link.open()
    # It is asked once, when the hub is connected.
    assert len(seen) == 1
    link.close()
    link.open()
    assert len(seen) == 2


def test_program_of_trials_has_the_pipe_and_the_tilt_that_are_asked_for() -> None:
    plain = trying(ScriptedHub())
    assert plain.program.pipe is Pipe.STDIN
    assert "LIMITS = ()" in plain.program.source
    assert trying(ScriptedHub(), pipe=Pipe.APP_DATA).program.pipe is Pipe.APP_DATA
    interface = replace(INTERFACE, channels=(*INTERFACE.channels, Pitch()))
    for options, limit in (({}, 35.0), ({"tilt_deg": 12.0}, 12.0)):
        link = TrialLink(
            ScriptedHub(),  # type: ignore[arg-type]
            TWO_WHEELER,
            interface,
            NUMBERS,
            POLICY,
            **options,
        )
        assert f"LIMITS = ((1, {limit}),)" in link.program.source


def test_program_of_a_link_has_the_pipe_that_is_asked_for() -> None:
    assert linked(ScriptedHub(promptly)).program.pipe is Pipe.STDIN
    assert linked(ScriptedHub(promptly), pipe=Pipe.APP_DATA).program.pipe is Pipe.APP_DATA
