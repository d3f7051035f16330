"""Link and program over a transport with loss and damage."""

from __future__ import annotations

import itertools
import logging
import random
import struct
from collections.abc import Callable

import pytest
from described import RUN_AWAY, SPINNING, TWO_WHEELER
from stand_in import StandInHub

from brickhub.errors import HubError, HubProgramError, HubProtocolError, HubTimeoutError
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink, LinkState
from brickhub.hub.program.generate import END_MS, WATCHDOG_MS, generate
from brickhub.hub.protocol import Down, EncodingError, control_frame
from brickhub.hub.transport import HubProgram


def make(hub: StandInHub, interface: Interface = SPINNING, **options: float) -> HubLink:
    return HubLink(hub, TWO_WHEELER, interface, **options)


def every(n: int, change: Callable[[bytes], bytes], first: int = 0) -> Callable[[bytes], bytes]:
    """Change every n-th chunk."""
    count = -first

    def apply(data: bytes) -> bytes:
        nonlocal count
        count += 1
        return change(data) if count > 0 and count % n == 0 else data

    return apply


def is_sign_of_life(data: bytes) -> bool:
    return data[1] == 0 and data[2] == Down.WATCHDOG


def lose(data: bytes) -> bytes:
    return b""


def damage(data: bytes) -> bytes:
    return data[:-1] + bytes([data[-1] ^ 0x10])


def test_open_act_read_close() -> None:
    hub = StandInHub()
    hub.tilt = (1.5, -2.25)
    link = make(hub)
    assert link.state is LinkState.DISCONNECTED
    link.open()
    assert link.state is LinkState.READY
    first = link.read()
    assert link.state is LinkState.READY
    reading = link.act([30, -20])
    assert link.state is LinkState.ARMED
    assert reading.values == (30, 340, 1.5, -2.25, 0)
    assert reading.hub_time_ms - first.hub_time_ms == pytest.approx(100, abs=5)
    assert reading.round_trip_s == pytest.approx(0.1, abs=0.005)
    link.close()
    assert not hub.running and link.state is LinkState.DISCONNECTED


def test_link_is_a_context_manager() -> None:
    hub = StandInHub()
    with make(hub) as link:
        link.open()  # once more is no harm
        assert hub.starts == 1
    link.close()
    assert not hub.running and hub.closes == 2


def test_failed_open_closes_link() -> None:
    hub = StandInHub()
    hub.unplugged.add("E")
    with pytest.raises(HubProgramError), make(hub):
        pass
    assert hub.closes == 1


def test_closed_link_raises() -> None:
    link = make(StandInHub())
    for call in (link.read, lambda: link.act([0, 0])):
        with pytest.raises(HubError, match=r"call open\(\) first"):
            call()
    link.stop()
    link.close()


def test_hub_clock_is_unwrapped() -> None:
    hub = StandInHub()
    with make(hub) as link:
        times = []
        for _ in range(30):
            times.append(link.read().hub_time_ms)
            hub.run_ms(7000)
        assert [later - time for time, later in itertools.pairwise(times)] == pytest.approx(
            [7000] * 29, abs=10
        )


@pytest.mark.parametrize("change", [lose, damage])
@pytest.mark.parametrize("direction", ["down", "up"])
def test_lost_frame_never_moves_twice(direction: str, change: Callable[[bytes], bytes]) -> None:
    hub = StandInHub()
    with make(hub, timeout_s=2.0) as link:
        harm = every(3, change)
        setattr(hub, direction, lambda data: data if is_sign_of_life(data) else harm(data))
        for step in range(40):
            link.act([step, -step])
        assert [move[-1] for move in hub.moves] == [
            angle for step in range(40) for angle in (step, -step)
        ]
        assert link.statistics.resends >= 13
        assert link.statistics.exchanges == 40


def test_noise_in_both_directions() -> None:
    hub = StandInHub()
    noise = random.Random(3)
    with make(hub, timeout_s=8.0) as link:
        hub.up = lambda data: (
            bytes(noise.choices([0xA5, 0, 1, 72, 200], k=noise.randint(0, 15))) + data
        )
        hub.down = every(2, damage)
        for step in range(30):
            assert link.act([step, 0]).values[0] == pytest.approx(hub.motors["E"].angle() % 360)
        assert len(hub.moves) == 60
        assert link.statistics.skipped_bytes > 0


def test_duplicated_answers_are_ignored() -> None:
    hub = StandInHub()
    with make(hub) as link:
        hub.up = lambda data: data * 2
        angles = [link.act([10, 0]).values[0] for _ in range(5)]
        assert angles == [10, 20, 30, 40, 50]
        assert link.statistics.stale_answers == 4


def test_duplicated_commands_run_once() -> None:
    hub = StandInHub(stdin_bytes=63)
    with make(hub) as link:
        hub.down = lambda data: data * 2
        for _ in range(5):
            link.act([10, 0])
        assert len(hub.moves) == 10


def test_silent_hub_times_out_then_faults() -> None:
    hub = StandInHub()
    link = make(hub, timeout_s=1.0)
    link.open()
    hub.up = lose
    started_s = hub.now_s()
    with pytest.raises(HubTimeoutError, match="did not answer within 1.1 s"):
        link.act([1, 1])
    assert hub.now_s() - started_s == pytest.approx(1.1, abs=0.05)
    assert link.state is LinkState.FAULT
    with pytest.raises(HubError, match="call open"):
        link.read()
    hub.up = lambda data: data
    link.open()
    assert link.state is LinkState.READY and len(hub.moves) == 2
    link.act([1, 1])
    link.close()


def test_long_move_extends_timeout() -> None:
    hub = StandInHub()
    with make(hub, RUN_AWAY, timeout_s=0.4) as link:
        hub.motors["A"].blocked = True
        reading = link.act([60])
        assert reading.round_trip_s == pytest.approx(3.0, abs=0.01)
        assert hub.moves == [("straight", 60)]
        assert link.statistics.resends > 0 and link.statistics.stale_answers == 0


class FrozenHub(StandInHub):
    """Its clock stands still, and it sends nothing useful."""

    def __init__(self, noise: bytes) -> None:
        super().__init__()
        self.noise, self.reads = noise, 0

    def read(self, timeout_s: float) -> bytes:
        self.reads += 1
        return self.noise

    def now_s(self) -> float:
        return 0.0


@pytest.mark.parametrize("noise", [b"", b"x", b"\xa5\x01", b"\xa5\x00H"])
def test_stopped_clock_does_not_hang(noise: bytes) -> None:
    hub = FrozenHub(noise)
    with pytest.raises(HubTimeoutError):
        make(hub).open()
    assert hub.reads < 10_000


def test_lost_hello_is_requested() -> None:
    hub = StandInHub()
    hub.up = every(1, lose)
    hub.down = lambda data: (setattr(hub, "up", lambda answer: answer), data)[1]
    link = make(hub)
    link.open()
    assert hub.writes == [control_frame(Down.HELLO)]
    link.act([5, 5])
    link.close()


def test_other_program_is_detected() -> None:
    class OtherProgram(StandInHub):
        def start(self, program: HubProgram) -> None:
            super().start(generate(TWO_WHEELER, RUN_AWAY))

    with pytest.raises(HubProtocolError, match="another program"):
        make(OtherProgram()).open()


def test_other_protocol_is_detected() -> None:
    class OtherVersion(StandInHub):
        def start(self, program: HubProgram) -> None:
            source = program.source.replace(
                "HELLO_HEAD = bytes([MAGIC, 0, 72, 1])", "HELLO_HEAD = bytes([MAGIC, 0, 72, 2])"
            )
            super().start(HubProgram(source, program.hash))

    with pytest.raises(HubProtocolError, match="speaks protocol 2"):
        make(OtherVersion()).open()


def test_missing_device_raises_at_start() -> None:
    hub = StandInHub()
    hub.unplugged.add("E")
    link = make(hub)
    with pytest.raises(
        HubProgramError, match=r"ENODEV.*motor_left = Motor\(Port.E, .*; plug"
    ) as info:
        link.open()
    assert "\n" not in str(info.value)
    hub.unplugged.clear()
    link.open()
    assert link.state is LinkState.READY


def test_unplugged_device_raises() -> None:
    hub = StandInHub()
    link = make(hub)
    link.open()
    hub.unplugged.add("A")
    with pytest.raises(HubProgramError, match=r"ENODEV.*motor_right.run_angle"):
        link.act([1, 1])
    assert link.state is LinkState.FAULT


def test_invalid_values_send_nothing() -> None:
    hub = StandInHub()
    with make(hub) as link:
        for values in ([float("nan"), 0], [1], []):
            with pytest.raises(EncodingError):
                link.act(values)
        assert link.state is LinkState.READY and hub.writes == []


def test_read_after_silence_restarts_program() -> None:
    hub = StandInHub()
    with make(hub) as link:
        link.act([10, 10])
        sleep_ms(hub, END_MS + WATCHDOG_MS + 100)
        assert not hub.running
        reading = link.read()
        assert hub.starts == 2 and link.state is LinkState.READY
        assert reading.hub_time_ms < 1000


def test_act_after_silence_raises() -> None:
    hub = StandInHub()
    with make(hub) as link:
        link.act([10, 10])
        sleep_ms(hub, END_MS + WATCHDOG_MS + 100)
        with pytest.raises(HubError, match=r"not heard from this computer.*open\(\)"):
            link.act([10, 10])
        link.open()
        link.act([10, 10])
        assert len(hub.moves) == 4


def test_reading_keeps_motors_powered() -> None:
    hub = StandInHub()
    with make(hub) as link:
        link.act([10, 10])
        for _ in range(10):
            sleep_ms(hub, WATCHDOG_MS - 110)  # after a step of 100 ms, in which nothing was sent
            link.read()
        assert not any(motor.stops for motor in hub.motors.values())
        assert link.state is LinkState.ARMED


def test_open_after_stop_restarts() -> None:
    hub = StandInHub()
    link = make(hub)
    link.open()
    link.act([100, 100])
    link.stop()
    assert not hub.running and link.state is LinkState.DISCONNECTED
    assert not any(motor.moving for motor in hub.motors.values())
    link.open()
    link.read()
    link.close()


def test_close_never_raises(caplog: pytest.LogCaptureFixture) -> None:
    class Broken(StandInHub):
        def stop(self) -> None:
            if self.starts:
                raise HubError("gone")

        def close(self) -> None:
            self.closes += 1
            raise RuntimeError("gone too")

    hub = Broken()
    link = make(hub)
    link.open()
    with caplog.at_level(logging.WARNING):
        link.close()
        link.close()
    assert hub.closes == 2 and link.state is LinkState.DISCONNECTED
    assert "could not stop (gone)" in caplog.text and "could not disconnect" in caplog.text
    assert [
        record.exc_info is not None and record.exc_info is not False
        for record in caplog.records[:2]
    ] == [False, True]


def test_transport_error_is_a_fault() -> None:
    hub = StandInHub()
    link = make(hub)
    link.open()
    hub.stop()
    with pytest.raises(HubError, match="no program runs"):
        link.act([1, 1])
    assert link.state is LinkState.FAULT
    link.close()


def test_timeout_message_has_last_output() -> None:
    hub = StandInHub()
    link = make(hub, timeout_s=1.0)
    link.open()
    hub.up = lambda data: b"hot motor!\r\n"
    with pytest.raises(HubTimeoutError, match="it printed: hot motor!"):
        link.read()


def test_watchdog_grows_with_delay() -> None:
    hub = StandInHub()
    with make(hub, watchdog_s=0.6) as link:
        assert hub.writes == [control_frame(Down.WATCHDOG, struct.pack("<H", 600))]
        delayed = DelayedWrites(hub, 300)
        link._transport = delayed
        for _ in range(101):
            link.read()
        assert link.statistics.watchdog_s == pytest.approx(1.2, abs=0.05)
        watchdogs = [write for write in hub.writes if write[2] == Down.WATCHDOG and write[1] == 0]
        assert len(watchdogs) == 2
        link.stop()
        hub.writes.clear()
        # the new program has its own short watchdog, which a slow link would never outlive
        link.open()
        assert hub.writes[0] == watchdogs[1]


class DelayedWrites:
    """A transport with slow writes."""

    def __init__(self, hub: StandInHub, delay_ms: int) -> None:
        self.hub, self.delay_ms = hub, delay_ms
        self.read, self.start, self.stop, self.now_s, self.open = (
            hub.read,
            hub.start,
            hub.stop,
            hub.now_s,
            hub.open,
        )
        self.close = hub.close

    def write(self, data: bytes) -> None:
        sleep_ms(self.hub, self.delay_ms)
        self.hub.write(data)


def test_statistics() -> None:
    hub = StandInHub()
    link = make(hub)
    assert link.statistics.exchanges == 0 and link.statistics.round_trip_p99_s == 0.0
    with link:
        for _ in range(10):
            link.act([1, 1])
        statistics = link.statistics
    assert statistics.exchanges == 10
    assert 0.099 < statistics.round_trip_p50_s <= statistics.round_trip_p99_s < 0.11
    assert (
        statistics.resends,
        statistics.stale_answers,
        statistics.crc_errors,
        statistics.skipped_bytes,
    ) == (0, 0, 0, 0)
    assert statistics.watchdog_s == WATCHDOG_MS / 1000


def test_sequence_numbers_wrap() -> None:
    hub = StandInHub()
    with make(hub, timeout_s=1.0) as link:
        for _ in range(600):
            link.read()
        link.act([1, 1])
        assert link.statistics.resends == 0 and all(
            write[1] != 0 or write[2] != 0 for write in hub.writes
        )


def sleep_ms(hub: StandInHub, duration_ms: int) -> None:
    """Let time pass without reading."""
    kept = hub.run_ms(duration_ms)
    hub._outbox[:0] = kept
