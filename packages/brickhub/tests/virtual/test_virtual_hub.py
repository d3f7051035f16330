"""Virtual hub as a transport: connection events, buffers, stop, errors, simulated and real time."""

from __future__ import annotations

import itertools
import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from described import TWO_WHEELER

from brickhub.errors import HubError, HubProgramError, SceneError, TwinError
from brickhub.hub.link.profiles import LinkProfile
from brickhub.hub.transport import HubModule, HubProgram
from brickhub.robot import BENCH
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.micropython.exceptions import HostStop
from brickhub.virtual.virtual_transport import VirtualHub

ECHO = """
from usys import stdin, stdout
from uselect import poll
from pybricks.tools import wait
keys = poll()
keys.register(stdin)
stdout.buffer.write(b"hello")
while True:
    while not keys.poll(0):
        wait(1)
    stdout.buffer.write(stdin.buffer.read(1))
"""

DRIVE = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
from pybricks.tools import wait
from usys import stdout
motor = Motor(Port.A)
motor.run(500)
wait(1000)
stdout.buffer.write(b"up")
while True:
    wait(10)
"""

NEVER_WAITS = """
from pybricks.tools import StopWatch
watch = StopWatch()
while watch.time() < 50:
    pass
raise ValueError(watch.time())
"""


def hub(source: str, interval_ms: float = 15.0, **kwargs: bool) -> VirtualHub:
    hub = VirtualHub(BenchBody(TWO_WHEELER), link=LinkProfile(interval_ms), **kwargs)
    hub.open()
    hub.start(HubProgram(source, 0))
    return hub


def test_output_arrives_at_connection_event() -> None:
    virtual = hub(ECHO)
    assert virtual.read(1.0) == b"hello"
    assert virtual.now_s() == pytest.approx(0.015)


@pytest.mark.parametrize("interval_ms", [7.5, 15.0, 30.0, 45.0])
def test_exchange_takes_two_intervals(interval_ms: float) -> None:
    virtual = hub(ECHO, interval_ms)
    virtual.read(1.0)
    start_s, rounds = virtual.now_s(), 20
    for i in range(rounds):
        virtual.write(bytes([65 + i]))
        assert virtual.read(1.0) == bytes([65 + i])
    assert (virtual.now_s() - start_s) * 1000 / rounds == pytest.approx(2 * interval_ms, abs=1.0)


def test_zero_interval_has_no_delay() -> None:
    virtual = hub(ECHO, 0.0)
    virtual.read(1.0)
    start_s = virtual.now_s()
    virtual.write(b"x")
    assert virtual.read(1.0) == b"x"
    assert virtual.now_s() - start_s <= 0.002


def test_read_timeout_is_simulated_time() -> None:
    virtual = hub(ECHO)
    virtual.read(1.0)
    start_s = virtual.now_s()
    assert virtual.read(0.5) == b""
    assert virtual.now_s() - start_s == pytest.approx(0.5)


def test_writes_are_small() -> None:
    virtual = hub("from pybricks.tools import wait\nwhile True:\n    wait(100)\n")
    with pytest.raises(HubError, match="21 bytes"):
        virtual.write(bytes(21))


def test_stop_stops_motors() -> None:
    virtual = hub(DRIVE)
    assert virtual.read(2.0) == b"up"
    assert virtual.machine.servos["A"].speed_deg_s() > 400
    virtual.stop()
    virtual.machine.advance(2000)
    angle_mdeg = virtual.body.angle_mdeg("A")
    virtual.machine.advance(500)
    assert virtual.body.angle_mdeg("A") == pytest.approx(angle_mdeg, abs=1000)
    with pytest.raises(HubError, match="no program runs"):
        virtual.read(0.1)
    virtual.close()
    virtual.close()


def test_program_end_stops_motors() -> None:
    virtual = hub(DRIVE.replace("while True:\n    wait(10)\n", ""))
    assert virtual.read(2.0) == b"up"
    with pytest.raises(HubError, match="no program runs"):
        virtual.write(b"x")
    assert not virtual.machine.servos["A"].is_open


def test_hub_exception_is_one_line() -> None:
    virtual = hub(
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "Motor(Port.F)\n"
    )
    with pytest.raises(
        HubProgramError, match=r"OSError.*ENODEV.*line 3.*plug the device"
    ) as caught:
        virtual.read(0.1)
    assert "\n" not in str(caught.value)


def test_user_exception_reaches_host() -> None:
    virtual = hub("class Mine(BaseException):\n    pass\nraise Mine(3)\n")
    with pytest.raises(HubProgramError, match="Mine: 3"):
        virtual.read(0.1)


class Ended(HostStop):
    """An end of the host, in a module that the virtual hub does not know."""


@pytest.mark.parametrize("kind", [KeyboardInterrupt, Ended])
def test_host_exception_is_not_a_program_error(
    kind: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    virtual = hub(DRIVE)

    def press(_seconds: object) -> None:
        monkeypatch.undo()  # once, while the program runs
        raise kind

    monkeypatch.setattr(virtual.machine, "advance", press)
    with pytest.raises(kind):
        virtual.read(1.0)


def test_program_can_be_restarted() -> None:
    virtual = hub(DRIVE)
    virtual.read(2.0)
    virtual.start(HubProgram(ECHO, 0))
    assert virtual.read(1.0) == b"hello"


def test_busy_program_does_not_hang() -> None:
    virtual = hub(NEVER_WAITS)
    with pytest.raises(HubProgramError, match="ValueError: 5"):
        virtual.read(1.0)


def test_real_time_paces_the_robot() -> None:
    virtual = hub(ECHO, realtime=True)
    virtual.read(1.0)
    start_s, before_s = time.monotonic(), virtual.now_s()
    for _ in range(10):
        virtual.write(b"x")
        virtual.read(1.0)
    assert time.monotonic() - start_s == pytest.approx(virtual.now_s() - before_s, abs=0.03)
    # Two connection events each time; the first one may be near, where the host was slow to begin.
    assert virtual.now_s() - before_s > 10 * 0.030 - 0.015


def test_realtime_robot_does_not_wait_for_host() -> None:
    virtual = hub(ECHO, realtime=True)
    virtual.read(1.0)
    before_s = virtual.now_s()
    time.sleep(0.2)
    virtual.write(b"x")
    assert virtual.now_s() - before_s >= 0.2


def test_other_thread_is_told() -> None:
    virtual = hub("from pybricks.tools import wait\nwait(100000)")
    virtual.read(0.1)
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(TwinError, match="started in another thread"):
            pool.submit(virtual.read, 0.1).result()
        pool.submit(virtual.close).result()
    with pytest.raises(HubError, match="no program runs"):
        virtual.read(0.1)


def test_realtime_advances_in_steps_and_stops_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = hub("from pybricks.tools import wait\nwait(100000)", realtime=True)
    seen = []
    wait_for_real_time = virtual._wait_for_real_time

    def look() -> None:
        seen.append(virtual.machine.time_ms)
        wait_for_real_time()

    monkeypatch.setattr(virtual, "_wait_for_real_time", look)
    assert virtual.read(0.3) == b""
    assert max(b - a for a, b in itertools.pairwise(seen)) <= 15
    stopper = threading.Timer(0.1, virtual.stop)
    stopper.start()
    start_s = time.monotonic()
    with pytest.raises(HubError, match="no program runs"):
        virtual.read(5.0)
    assert time.monotonic() - start_s < 1.0


def test_realtime_motors_run_down_after_stop() -> None:
    source = (
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "from pybricks.tools import wait\n"
    )
    source += "motor = Motor(Port.A)\nmotor.dc(100)\nwait(10000)"
    virtual = VirtualHub(BenchBody(BENCH), realtime=True)
    virtual.start(HubProgram(source, 0))
    virtual.read(0.3)
    before_ms = virtual.machine.time_ms
    virtual.stop()
    assert 15 < virtual.machine.time_ms - before_ms <= 1000
    at_rest = virtual.body.angle_mdeg("A")
    virtual.machine.advance(200)
    assert abs(virtual.body.angle_mdeg("A") - at_rest) < 1000


def test_reset_during_program() -> None:
    virtual = hub(ECHO)
    virtual.read(1.0)
    seen = []
    virtual.body.reset = seen.append
    rng = random.Random(0)
    virtual.reset(rng)
    assert seen == [rng]
    virtual.write(b"x")
    assert virtual.read(1.0) == b"x"


def test_bench_has_hub() -> None:
    virtual = VirtualHub(BenchBody(BENCH))
    virtual.start(HubProgram(ECHO, 0))
    assert virtual.read(1.0) == b"hello"


APP_DATA = """
from pybricks.messaging import AppData
for modes in ([(300, 2)], ((0, 2),), [(0, 2), (0, 3)]):
    try:
        AppData(modes)
    except (TypeError, ValueError) as e:
        print(e)
app = AppData([(1, 3), (0, 2)])
for call in (lambda: app.write_bytes(bytes(20)), lambda: app.get_bytes(7), lambda: app.get_bytes(1, 3), lambda: AppData([])):
    try:
        call()
    except (ValueError, RuntimeError) as e:
        print(e)
print(app.get_bytes(1), app.get_bytes(0, 1))
"""  # noqa: E501


def test_app_data_refusals_equal_hub() -> None:
    virtual = hub(APP_DATA, 0.0)
    output = b"".join(iter(lambda: virtual.read(0.1) if virtual._wire.outbox else b"", b""))
    lines = output.replace(bytes((0, 0, 1)), b"").decode().splitlines()
    assert lines == [
        "modes must be a list of (mode, size) tuples",
        "can't convert tuple to list",
        "mode numbers must be unique",
        "Invalid argument",
        "invalid mode",
        "index out of range",
        "host rx_buffer already allocated",
        "b'\\x00\\x00\\x00' 0",
    ]


def test_program_has_modules_and_file_name() -> None:
    virtual = VirtualHub(BenchBody(TWO_WHEELER))
    arm = HubModule("arm", "arm.py", "def reach():\n    return 42\n")
    source = "import arm\nfrom pybricks.tools import wait\nprint(arm.reach())\nwait(100)\n1 / 0\n"
    virtual.start(HubProgram(source, 0, name="wave.py", modules=(arm,)))
    assert virtual.read(1.0) == b"42\r\n"
    with pytest.raises(HubProgramError, match=r"ZeroDivisionError.*at line 5 \(1 / 0\)"):
        virtual.read(1.0)
    virtual.close()


def is_driven(virtual: VirtualHub) -> bool:
    return any(servo.control.is_active for servo in virtual.machine.servos.values())


def test_motors_stop_when_the_world_fails() -> None:
    virtual = hub(DRIVE)
    assert virtual.read(5.0) == b"up" and is_driven(virtual)

    def fail() -> bool:
        raise SceneError("the scene fails")

    virtual.machine.turn = lambda _: fail()
    with pytest.raises(SceneError, match="the scene fails"):
        virtual.read(5.0)
    assert not is_driven(virtual)


def test_start_in_another_thread_stops_motors_of_the_earlier_program() -> None:
    virtual = hub(DRIVE)
    assert virtual.read(5.0) == b"up"
    with ThreadPoolExecutor(1) as pool:
        pool.submit(virtual.start, HubProgram(ECHO, 0)).result()
        assert pool.submit(virtual.read, 1.0).result() == b"hello" and not is_driven(virtual)
        pool.submit(virtual.stop).result()


def test_time_passes_up_to_a_moment_without_a_program_too() -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    times_ms = []
    for until_ms in (500, 700, 700, 600, 1001):
        hub.run_on_until(until_ms)
        times_ms.append(hub.machine.time_ms)
    assert times_ms == [500, 700, 700, 700, 1001]
    # And up to the same moment, once a program has ended.
    hub.start(HubProgram("print('done')\n", 1))
    hub.run_on_until(1500)
    hub.run_on_until(1750)
    assert hub.machine.time_ms == 1750
