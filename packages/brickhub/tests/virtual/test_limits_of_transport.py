"""A virtual hub as a transport, with a clock of the test's own in place of real time: exact times,
full buffers, and what is left when a program has ended."""

from __future__ import annotations

import random

import pytest
from described import TWO_WHEELER

from brickhub.errors import HubError, HubProgramError, ProgramStoppedError
from brickhub.hub.link.profiles import IDEAL, LinkProfile
from brickhub.hub.transport import HubProgram, Pipe
from brickhub.robot import BENCH, HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.machine import FIRMWARE_VERSIONS, Pace
from brickhub.virtual.virtual_transport import VirtualHub

START_MS = 1
"""A program begins in the first millisecond."""
WAITS = "from pybricks.tools import wait\nwait(100000)"
COUNTS = """
from pybricks.tools import wait
from usys import stdout
for number in range(5):
    wait(100)
    stdout.buffer.write(bytes([number]))
wait(100000)
"""
LISTENS = """
from pybricks.tools import wait
from usys import stdin, stdout
from uselect import poll
keys = poll()
keys.register(stdin)
wait(1000)
count = 0
while keys.poll(0):
    stdin.buffer.read(1)
    count += 1
stdout.buffer.write(bytes([count & 255, count >> 8]))
wait(100000)
"""


class Real:
    """Real time, which passes in sleeps, and where the test says so."""

    def __init__(self) -> None:
        self.now_s = 50.0
        self.slept_s = 0.0

    def clock_s(self) -> float:
        return self.now_s

    def sleep(self, time_s: float) -> None:
        self.slept_s += time_s
        self.now_s += time_s


def started(
    source: str,
    link: LinkProfile = IDEAL,
    real: Real | None = None,
    pipe: Pipe = Pipe.STDIN,
    robot: Robot = TWO_WHEELER,
) -> VirtualHub:
    hub = VirtualHub(BenchBody(robot), link=link)
    if real is not None:
        hub._pace = Pace(real.clock_s, real.sleep)
    hub.start(HubProgram(source, 0, pipe=pipe))
    return hub


# ---- real time


def test_whether_a_hub_runs_in_real_time() -> None:
    assert not VirtualHub(BenchBody(TWO_WHEELER)).is_realtime
    assert VirtualHub(BenchBody(TWO_WHEELER), realtime=True).is_realtime


def test_a_hub_in_real_time_waits_where_it_is_ahead() -> None:
    real = Real()
    hub = started(WAITS, real=real)
    assert hub.read(0.25) == b""
    assert hub.machine.time_ms == START_MS + 250
    assert real.slept_s == pytest.approx(hub.now_s(), abs=1e-6)


@pytest.mark.parametrize(
    ("late_ms", "caught_up_ms"),
    [(0.0, 0), (0.9, 0), (1.5, 1), (7.5, 7), (100.5, 100), (1000.5, 1000)],
)
def test_a_hub_in_real_time_catches_up_with_a_slow_host(late_ms: float, caught_up_ms: int) -> None:
    """Less than a millisecond behind is in time."""
    real = Real()
    hub = started(WAITS, real=real)
    assert hub.read(0.1) == b""
    real.now_s += late_ms / 1000
    before_ms = hub.machine.time_ms
    hub._keep_pace()
    assert hub.machine.time_ms - before_ms == caught_up_ms


def test_a_stopped_robot_runs_down_in_real_time_only() -> None:
    source = (
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "from pybricks.tools import wait\nmotor = Motor(Port.A)\nmotor.dc(100)\nwait(100000)"
    )
    simulated = started(source)
    simulated.read(0.5)
    simulated.stop()
    assert simulated.machine.time_ms == START_MS + 500
    real = Real()
    hub = started(source, real=real)
    hub.read(0.5)
    hub.stop()
    down_ms = hub.machine.time_ms - START_MS - 500
    assert 15 < down_ms <= 1005 and down_ms % 15 == 0
    assert real.slept_s == pytest.approx(hub.now_s(), abs=1e-6)
    before = hub.body.angle_mdeg("A")
    hub.machine.advance(15)
    assert abs(hub.body.angle_mdeg("A") - before) <= 50
    # Motors that stand are looked at twice.
    still = started(WAITS, real=Real())
    still.read(0.1)
    still.stop()
    assert still.machine.time_ms == START_MS + 100 + 15


# ---- reading


def test_each_output_is_read_at_its_time() -> None:
    hub = started(COUNTS)
    for number in range(5):
        assert hub.read(1.0) == bytes([number])
        # The host is told when the program next waits.
        assert hub.machine.time_ms == 100 * (number + 1) + 1
    assert hub.read(0.2) == b"" and hub.machine.time_ms == 701
    assert hub.read(0.0) == b"" and hub.machine.time_ms == 701


def test_a_late_reader_gets_all_that_has_arrived_as_one_piece() -> None:
    hub = started(COUNTS)
    hub.run_on_until(350)
    assert hub.read(0.0) == bytes([0, 1, 2])
    assert hub.machine.time_ms == 350
    assert hub.read(0.06) == bytes([3]) and hub.machine.time_ms == 401


@pytest.mark.parametrize(("interval_ms", "arrives_ms"), [(15.0, 105), (30.0, 120), (50.0, 150)])
def test_output_travels_in_the_next_connection_event(interval_ms: float, arrives_ms: int) -> None:
    hub = started(COUNTS, LinkProfile(interval_ms))
    assert hub.read(1.0) == bytes([0])
    assert hub.machine.time_ms == arrives_ms


def test_a_reader_gives_up_before_the_output_has_arrived() -> None:
    hub = started(COUNTS, LinkProfile(50.0))
    assert hub.read(0.148) == b"" and hub.machine.time_ms == 149
    assert hub.read(0.001) == bytes([0]) and hub.machine.time_ms == 150


# ---- writing


@pytest.mark.parametrize("waits", [True, False])
def test_a_write_waits_for_the_acknowledgement_unless_told(waits: bool) -> None:
    hub = started(WAITS, LinkProfile(20.0))
    hub.waits_for_acknowledgement = waits
    hub.write(b"x")
    assert hub.machine.time_ms == (40 if waits else 20)


@pytest.mark.parametrize("version", ["4.1", "4.0"])
@pytest.mark.parametrize("kind", [HubKind.PRIME, HubKind.MOVE, HubKind.CITY])
def test_input_that_does_not_fit_the_buffer_is_refused(version: str, kind: HubKind) -> None:
    """Since 4.1 a hub takes a whole packet at least."""
    hub = VirtualHub(BenchBody(Robot("it", kind)), link=IDEAL)
    hub.machine.firmware = FIRMWARE_VERSIONS[version]
    hub.start(HubProgram(WAITS, 0))
    model = kind.model
    capacity = model.stdin_bytes
    if version == "4.1":
        capacity = max(model.stdin_bytes, model.packet_bytes)
    for start in range(0, capacity, 20):
        hub.write(bytes(min(20, capacity - start)))
    with pytest.raises(HubError, match="input buffer is full; wait for the program's answer"):
        hub.write(b"x")
    hub.write(b"")


def test_a_program_reads_all_that_was_written() -> None:
    hub = started(LISTENS)
    for size in (20, 1, 13):
        hub.write(bytes(size))
    assert hub.read(2.0) == bytes([34, 0])


def test_a_write_has_20_bytes_at_most() -> None:
    hub = started(WAITS)
    hub.write(bytes(20))
    with pytest.raises(HubError, match="21 bytes in one write; split them into 20 bytes or less"):
        hub.write(bytes(21))


def test_a_program_without_app_data_takes_none() -> None:
    hub = started(WAITS, pipe=Pipe.APP_DATA)
    with pytest.raises(HubError, match="has no AppData buffer; create AppData in it"):
        hub.write(b"x")


# ---- ends


def test_what_a_program_wrote_is_read_before_its_end_is_told() -> None:
    source = "from usys import stdout\nstdout.buffer.write(b'last')\n"
    hub = started(source)
    assert hub.read(1.0) == b"last"
    with pytest.raises(ProgramStoppedError, match="no program runs on the hub; start one"):
        hub.read(1.0)
    with pytest.raises(ProgramStoppedError, match="no program runs on the hub; start one"):
        hub.write(b"x")
    failed = started(source + "1 / 0\n")
    assert failed.read(1.0) == b"last"
    with pytest.raises(HubProgramError, match="ZeroDivisionError: divide by zero"):
        failed.read(1.0)
    failed.start(HubProgram(WAITS, 0))
    assert failed.read(0.1) == b"", "the error was that of the former program"


def test_a_hub_out_of_reach_answers_nothing() -> None:
    hub = started(WAITS)
    hub.in_reach = lambda: False
    for call in (hub.open, lambda: hub.read(0.1), lambda: hub.write(b"x")):
        with pytest.raises(HubError, match="the virtual hub is out of reach; bring it back"):
            call()
    hub.in_reach = lambda: True
    hub.open()
    assert hub.read(0.1) == b""


def test_placing_a_robot_takes_a_second() -> None:
    hub = started(WAITS)
    hub.reset(random.Random(0))
    assert hub.machine.time_ms == START_MS + 1000


def test_the_link_is_the_given_one_or_the_bodys() -> None:
    body = BenchBody(BENCH)
    body.link = LinkProfile(33.0)
    assert VirtualHub(body).link == LinkProfile(33.0)
    assert VirtualHub(body, link=IDEAL).link == IDEAL
