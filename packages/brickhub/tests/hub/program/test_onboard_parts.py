"""Parts of programs on a hub, one by one in plain Python: reckoning, goals, steps, joints, frames,
what a policy reads, and what programs of the survey print."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from brickhub.hub.program.generate import onboard_text
from brickhub.hub.protocol import crc8, data_frame
from brickhub.hub.transport import app_data_slot


class Clock:
    """Time (ms) that passes by waiting."""

    def __init__(self) -> None:
        self.now_ms = 0
        self.waits: list[int] = []

    def wait(self, time_ms: int) -> None:
        self.waits.append(time_ms)
        self.now_ms += time_ms

    def watch(self) -> Any:
        """A StopWatch."""
        start = [self.now_ms]

        def reset() -> None:
            start[0] = self.now_ms

        return SimpleNamespace(time=lambda: self.now_ms - start[0], reset=reset)


def part(name: str, clock: Clock | None = None, **names: Any) -> dict[str, Any]:
    """The names that a part of a program defines, with others that are there before it."""
    lines = onboard_text(name).splitlines()
    # What a hub imports is given instead.
    kept = [line for line in lines if not line.startswith(("import ", "from "))]
    clock = clock or Clock()
    defined: dict[str, Any] = {
        "umath": math,
        "StopWatch": clock.watch,
        "wait": clock.wait,
        **names,
    }
    exec("\n".join(kept), defined)  # noqa: S102  our own program
    return defined


class Reckoned:
    """A robot whose wheels have a diameter such that 1 mm is 2 degrees, 100 mm apart."""

    def __init__(self, start: tuple[float, ...], place: tuple[float, ...]) -> None:
        self.angles_deg = [350.0, 10.0]
        self.part = part(
            "reckoning",
            START=start,
            PLACE=place,
            DEG_PER_MM=2.0,
            TRACK_MM=100.0,
            wheels=lambda: tuple(angle % 360 for angle in self.angles_deg),
        )
        # The first call only tells where the wheels are.
        self.first = self.part["seen_place"]()

    def roll(self, left_mm: float, right_mm: float) -> list[float]:
        """Roll the wheels, and see the place."""
        self.angles_deg[0] += 2.0 * left_mm
        self.angles_deg[1] += 2.0 * right_mm
        seen: list[float] = self.part["seen_place"]()
        return seen

    @property
    def pose(self) -> list[float]:
        pose: list[float] = self.part["pose"]
        return pose


def test_place_is_seen_from_where_the_robot_is_put() -> None:
    # Headings are clockwise from x; left is counterclockwise.
    seen = Reckoned((0.0, 0.0, 0.0), (300.0, 50.0, 30.0)).first
    assert seen == pytest.approx([300.0, 50.0, 30.0, 0.0, 0.0])
    seen = Reckoned((100.0, 20.0, 90.0), (100.0, -80.0, 270.0)).first
    assert seen[:2] == pytest.approx([100.0, 0.0], abs=1e-9)
    assert abs(seen[2]) == pytest.approx(180.0)
    seen = Reckoned((0.0, 0.0, -90.0), (50.0, 0.0, 0.0)).first
    assert seen[:3] == pytest.approx([0.0, -50.0, 90.0], abs=1e-9)


def test_way_straight_ahead() -> None:
    robot = Reckoned((10.0, 20.0, 90.0), (10.0, -100.0, 90.0))
    assert robot.roll(50.0, 50.0) == pytest.approx([70.0, 0.0, 0.0, 50.0, 0.0], abs=1e-9)
    # Clockwise by 90 degrees from x is along -y.
    assert robot.pose == pytest.approx([10.0, -30.0, 90.0])
    assert robot.roll(-30.0, -30.0)[:4] == pytest.approx([100.0, 0.0, 0.0, -30.0], abs=1e-9)


def test_turn_on_the_spot() -> None:
    robot = Reckoned((0.0, 0.0, 0.0), (100.0, 0.0, 0.0))
    quarter_mm = math.pi * 100.0 / 4
    seen = robot.roll(quarter_mm, -quarter_mm)
    # The robot has turned to the right, so that the place is to its left.
    assert seen == pytest.approx([0.0, 100.0, -90.0, 0.0, 90.0], abs=1e-9)
    assert robot.pose == pytest.approx([0.0, 0.0, 90.0], abs=1e-9)


def test_arc_ends_where_its_chord_does() -> None:
    """A quarter of a circle of 200 mm to the right: the wheels roll on 250 and 150 mm."""
    robot = Reckoned((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    # A wheel that turns by half a turn or more between two looks is not told from one that turns
    # back, so the arc has four parts.
    for _ in range(8):
        seen = robot.roll(math.pi / 16 * 250.0, math.pi / 16 * 150.0)
    assert robot.pose == pytest.approx([200.0, -200.0, 90.0])
    assert seen[3:] == pytest.approx([math.pi / 16 * 200.0, 90.0 / 8])
    assert seen[2] == pytest.approx(-90.0)


@pytest.mark.parametrize(
    ("angle", "signed"), [(0, 0), (179, 179), (180, -180), (181, -179), (-181, 179), (720, 0)]
)
def test_angle_between_half_turns(angle: float, signed: float) -> None:
    robot = Reckoned((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert robot.part["signed"](angle) == signed


def test_goals_are_drawn_anew_after_their_steps() -> None:
    drawn: list[tuple[str, float, float]] = []

    def draw(kind: str) -> Callable[[float, float], float]:
        def one(low: float, high: float) -> float:
            drawn.append((kind, low, high))
            return len(drawn)

        return one

    goals = part(
        "goals",
        GOALS=((1, 4), (0.5, 2.0)),
        GOAL_STEPS=3,
        randint=draw("whole"),
        uniform=draw("any"),
    )["goals"]
    assert [goals() for _ in range(7)] == [[1, 2]] * 3 + [[3, 4]] * 3 + [[5, 6]]
    assert drawn[:2] == [("whole", 1, 4), ("any", 0.5, 2.0)]


@pytest.mark.parametrize(
    ("counting", "read"),
    [((), [1.0, 350.0, 5.0]), ((1,), [1.0, 340.0, 5.0]), ((0, 2), [0.5, 350.0, 4.0])],
)
def test_what_counts_on_is_read_from_the_start(
    counting: tuple[int, ...], read: list[float]
) -> None:
    relative = part("relative", COUNTING=counting)["relative"]
    observed = [1.0, 350.0, 5.0]
    assert relative(observed, [0.5, 10.0, 1.0]) == read
    assert observed == [1.0, 350.0, 5.0]


@pytest.mark.parametrize(
    ("value", "low", "high", "scale", "amount"),
    [
        (104, -1000, 1000, 10, 10),
        (105, -1000, 1000, 10, 11),
        (-105, -1000, 1000, 10, -10),
        (-106, -1000, 1000, 10, -11),
        (9999, -1000, 500, 10, 50),
        (-9999, -1000, 500, 10, -100),
        (7, 0, 9, 1, 7),
    ],
)
def test_amounts_are_whole_and_within_their_range(
    value: int, low: int, high: int, scale: int, amount: int
) -> None:
    whole = part("moves", MOVERS=[])["whole"]
    assert whole(value, low, high, scale) == amount


class Mover:
    """A motor that stops, or is unplugged."""

    def __init__(self, *, is_unplugged: bool = False, done_after: int = 0) -> None:
        self.is_unplugged = is_unplugged
        self.stops = 0
        self._left = done_after

    def stop(self) -> None:
        if self.is_unplugged:
            raise OSError(19)
        self.stops += 1

    def done(self) -> bool:
        self._left -= 1
        return self._left < 0


def test_all_motors_are_stopped_but_those_that_are_unplugged() -> None:
    movers = [Mover(), Mover(is_unplugged=True), Mover()]
    part("moves", MOVERS=movers)["stop_motors"]()
    assert [mover.stops for mover in movers] == [1, 0, 1]


class Motor:
    """A motor whose moves are noted; ``is_done`` is what it answers."""

    def __init__(self) -> None:
        self.at_deg = 20
        self.is_done = True
        self.calls: list[tuple[Any, ...]] = []

    def angle(self) -> int:
        return self.at_deg

    def done(self) -> bool:
        return self.is_done

    def run_target(self, speed: int, target: int, wait: bool) -> None:
        self.calls.append((speed, target, wait))

    def stop(self) -> None:
        self.calls.append(("stop",))


def test_joint_counts_from_the_target_that_it_holds() -> None:
    motor = Motor()
    joint = part("joint")["Joint"](motor, -30, 90)
    assert joint.angle() == 20
    assert joint.done()
    joint.turn(250, 15)
    # It sags by a little, which is not added up.
    motor.at_deg = 33
    joint.turn(250, 15)
    assert motor.calls == [(250, 35, False), (250, 50, False)]
    # One that has not arrived counts from where it is.
    motor.is_done = False
    motor.at_deg = 40
    joint.turn(200, -15)
    assert motor.calls[-1] == (200, 25, False)
    motor.is_done = True
    joint.turn(200, 500)
    joint.turn(200, -5)
    joint.turn(200, -500)
    assert [target for _, target, _ in motor.calls[-3:]] == [90, 85, -30]
    joint.stop()
    assert motor.calls[-1] == ("stop",)
    motor.at_deg = 7
    joint.turn(200, 3)
    assert motor.calls[-1] == (200, 10, False)


def reader(*received: bytes) -> tuple[Any, list[int]]:
    """A reader of frames with 4 bytes of numbers, that receives such pieces; and how long it was
    ready to wait for each."""
    pieces = list(received)
    patience: list[int] = []

    def receive(patience_ms: int) -> bytes:
        patience.append(patience_ms)
        return pieces.pop(0) if pieces else b""

    made = part(
        "frames",
        MAGIC=0xA5,
        CRC_POLYNOMIAL=0x107,
        COMMAND_BYTES=7,
        CONTROL_BYTES={ord("H"): 4, ord("R"): 5},
        PIECE_BYTES=19,
        receive=receive,
    )["Reader"]()
    return made, patience


FRAME = data_frame(3, b"abcd")
HELLO = bytes((0xA5, 0, ord("H")))
HELLO += bytes((crc8(HELLO),))


@pytest.mark.parametrize(
    "pieces",
    [
        (FRAME,),
        (FRAME[:2], FRAME[2:]),
        tuple(bytes((byte,)) for byte in FRAME),
        (b"noise" + FRAME,),
        (b"\xa5\x00?" + FRAME,),
        (b"\xa5", FRAME),
        (FRAME[:-1] + b"\x00" + FRAME,),
    ],
)
def test_frames_are_cut_out_of_what_comes(pieces: tuple[bytes, ...]) -> None:
    made, patience = reader(*pieces, HELLO)
    assert made.frame(80) == FRAME
    # It is waited once only.
    assert patience[0] == 80
    assert set(patience[1:]) <= {0}
    assert made.frame(5) == HELLO
    assert made.frame(7) is None
    assert patience[-1] == 7


def test_noise_cannot_keep_a_hub_busy() -> None:
    made, _ = reader(b"x" * 63 + FRAME)
    assert made.frame(0) is None
    assert made.frame(0) == FRAME


def test_frames_are_sent_in_pieces_with_their_checksum() -> None:
    sent: list[bytes] = []
    made = part("frames", MAGIC=0xA5, CRC_POLYNOMIAL=0x107, PIECE_BYTES=19, put=sent.append)
    head = bytes((0xA5, 9)) + bytes(range(40))
    made["send"](head)
    assert [len(piece) for piece in sent] == [19, 19, 5]
    assert b"".join(sent) == data_frame(9, bytes(range(40)))
    assert made["crc8"](b"123456789") == 0xF4


@pytest.mark.parametrize(
    ("value", "wired"),
    [(1.4, 1), (1.6, 2), (-1.6, -2), (32_767.4, 32_767), (40_000, 32_767), (-40_000, -32_768)],
)
def test_numbers_on_the_wire_saturate(value: float, wired: int) -> None:
    made = part("frames", MAGIC=0xA5, CRC_POLYNOMIAL=0x107, PIECE_BYTES=19)
    assert made["wire"](value) == wired


def app_data(slots: list[bytes], clock: Clock) -> tuple[dict[str, Any], list[bytes]]:
    """The part that talks by AppData; each look takes the next slot, the last one stays."""
    written: list[bytes] = []

    def write_bytes(data: bytes) -> None:
        if data == b"nobody":
            raise OSError
        written.append(data)

    def get_bytes(index: int) -> bytes:
        assert index == 0
        return slots.pop(0) if len(slots) > 1 else slots[0]

    def make(layout: list[tuple[int, int]]) -> Any:
        assert layout == [(0, 22)]
        return SimpleNamespace(get_bytes=get_bytes, write_bytes=write_bytes)

    made = part("app_data", clock, SLOT_BYTES=22, AppData=make)
    return made, written


def test_app_data_is_taken_once_for_each_count() -> None:
    clock = Clock()
    empty, first = bytes(22), app_data_slot(1, b"abc").ljust(22, b"x")
    made, written = app_data([empty, empty, first], clock)
    assert made["receive"](50) == b"abc"
    assert clock.now_ms == 2
    assert made["receive"](50) == b""
    assert clock.now_ms == 52
    made["put"](b"piece")
    made["put"](b"nobody")
    assert written == [b"piece"]


@pytest.mark.parametrize(
    ("is_until_done", "done_after", "ends_ms", "stops"),
    [(False, 0, 80, 0), (True, 4, 20, 0), (True, 99, 80, 1), (True, 0, 0, 0)],
)
def test_step_of_a_program_that_acts_by_itself(
    is_until_done: bool, done_after: int, ends_ms: int, stops: int
) -> None:
    clock = Clock()
    mover = Mover(done_after=done_after)
    names = {
        "SETTLE_MS": 80,
        "UNTIL_DONE": is_until_done,
        "MOVERS": [mover],
        "LOOK_MS": 5,
        "SPANS": ((0.0, 1.0),),
        "AGE_MS": 0,
    }
    steps = 0

    def observe() -> list[float]:
        nonlocal steps
        steps += 1
        if steps == 2:
            raise SystemExit
        return [0.0]

    with pytest.raises(SystemExit):
        part(
            "alone",
            clock,
            **names,
            observe=observe,
            relative=lambda observed, first: observed,
            act=lambda observed: [0.0],
            start_moves=lambda commands: None,
            stop_motors=lambda: None,
            print=lambda *_: None,
        )
    assert clock.now_ms == ends_ms
    assert mover.stops == stops


def test_program_that_acts_by_itself_says_what_it_does() -> None:
    """Its commands start as late as those over a link."""
    clock = Clock()
    started: list[tuple[int, list[int]]] = []
    printed: list[tuple[Any, ...]] = []
    firsts: list[Any] = []
    stopped: list[int] = []
    observations = iter([[10.0], [12.0]])

    def observe() -> list[float]:
        observed = next(observations, None)
        if observed is None:
            raise SystemExit
        return observed

    def relative(observed: list[float], first: list[float]) -> list[float]:
        firsts.append(first)
        return [observed[0] - first[0]]

    def act(observed: list[float]) -> list[float]:
        clock.now_ms += 4
        return [0.5, -1.0]

    with pytest.raises(SystemExit):
        part(
            "alone",
            clock,
            SETTLE_MS=10,
            UNTIL_DONE=False,
            MOVERS=[],
            LOOK_MS=5,
            SPANS=((1000.0, 2000.0), (0.0, 300.0)),
            AGE_MS=30,
            observe=observe,
            relative=relative,
            act=act,
            start_moves=lambda commands: started.append((clock.now_ms, list(commands))),
            stop_motors=lambda: stopped.append(clock.now_ms),
            print=lambda *values: printed.append(values),
        )
    assert started == [(30, [2000, -300]), (70, [2000, -300])]
    assert printed == [(4, 0.0, 2000, -300), (4, 2.0, 2000, -300)]
    assert firsts == [[10.0], [10.0]]
    assert stopped == [80]


def test_inventory_says_what_is_there() -> None:
    class Found:
        def __init__(self, port: str, direction: object, gears: object) -> None:
            if port == "B":
                raise OSError(19)
            self.port = port

        def angle(self) -> int:
            return 42

    hub = SimpleNamespace(
        battery=SimpleNamespace(voltage=lambda: 7800),
        system=SimpleNamespace(name=lambda: "Rover"),
        imu=SimpleNamespace(tilt=lambda: (1.6, -2.4), ready=lambda: True, stationary=lambda: False),
    )
    for has_imu in (True, False):
        printed: list[Any] = []
        part(
            "inventory",
            PORTS=(("A", "a"), ("B", "b")),
            MOTORS=(("left", "A", 1, None), ("right", "B", 1, None)),
            HAS_IMU=has_imu,
            device_id={"a": 48, "b": 0}.__getitem__,
            Motor=Found,
            hub=hub,
            version=("prime", "4.0.1"),
            print=printed.append,
        )
        told = {
            "ports": {"A": 48, "B": 0},
            "angles_deg": {"left": 42},
            "battery_mv": 7800,
            "firmware": "4.0.1",
            "name": "Rover",
        }
        if has_imu:
            told |= {"imu_ready": True, "imu_still": False, "pitch_deg": 2, "roll_deg": -2}
        assert printed == [told, "end"]
        assert ast.literal_eval(str(printed[0])) == told


class StoppedMotor:
    """A motor between stops, which turns by a degree in 10 ms."""

    stops_deg: tuple[int, int] | None = (-20, 51)
    made: ClassVar[list[StoppedMotor]] = []

    def __init__(self, port: str, direction: object, gears: object) -> None:
        self.made.append(self)
        self.at_deg = 0
        self.speed = 0
        self.target_deg: int | None = None
        self.limits: dict[str, int] = {}
        self.control = SimpleNamespace(limits=self.limits.update)

    def run(self, speed: int) -> None:
        self.speed = speed

    def stop(self) -> None:
        self.speed = 0

    def step(self) -> None:
        self.at_deg += (self.speed > 0) - (self.speed < 0)
        if self.stops_deg is not None:
            low, high = self.stops_deg
            self.at_deg = max(low, min(high, self.at_deg))

    def angle(self) -> int:
        return self.at_deg

    def stalled(self) -> bool:
        if self.stops_deg is None:
            return False
        low, high = self.stops_deg
        return self.at_deg == (low if self.speed < 0 else high)

    def run_target(self, speed: int, target: int, wait: bool) -> None:
        self.target_deg = target
        assert not wait

    def done(self) -> bool:
        return True


class TurningClock(Clock):
    """Motors turn while it is waited."""

    def wait(self, time_ms: int) -> None:
        super().wait(time_ms)
        for motor in StoppedMotor.made:
            motor.step()


def stops_found(
    monkeypatch: pytest.MonkeyPatch, stops: tuple[int, int] | None, limit_ms: int = 10_000
) -> list[Any]:
    """What the program prints that turns a joint to its stops."""
    monkeypatch.setattr(StoppedMotor, "made", [])
    monkeypatch.setattr(StoppedMotor, "stops_deg", stops)
    printed: list[Any] = []
    part(
        "find_stops",
        TurningClock(),
        MOTORS=(("arm", "A", 1, None),),
        TORQUE_MNM=250,
        SPEED_DEG_S=60,
        LIMIT_MS=limit_ms,
        LIMIT_DEG=400,
        Motor=StoppedMotor,
        print=lambda *words: printed.append(words),
    )
    return printed


def test_joint_is_turned_to_both_stops_and_to_the_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stops_found(monkeypatch, (-20, 51)) == [("stops", "arm", -20, 51), ("end",)]
    (motor,) = StoppedMotor.made
    assert motor.limits == {"torque": 250}
    assert motor.target_deg == 15
    assert motor.speed == 0


def test_joint_without_stops_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stops_found(monkeypatch, None) == [("free", "arm"), ("end",)]
    (motor,) = StoppedMotor.made
    # It went to 401 degrees one way, and back as far.
    assert abs(motor.at_deg) < 405
    assert (motor.speed, motor.target_deg) == (0, None)


def test_joint_whose_stop_is_far_is_given_up_by_the_angle_or_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert stops_found(monkeypatch, (-400, 0))[0] == ("stops", "arm", -400, 0)
    assert stops_found(monkeypatch, (-402, 0))[0] == ("free", "arm")
    assert stops_found(monkeypatch, (-100, 0), 1000)[0] == ("stops", "arm", -100, 0)
    assert stops_found(monkeypatch, (-102, 0), 1000)[0] == ("free", "arm")
