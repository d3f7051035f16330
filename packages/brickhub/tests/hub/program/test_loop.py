"""The generated program on all kinds of input."""

from __future__ import annotations

import random
import struct
from dataclasses import replace

import pytest
from described import RUN_AWAY, SPINNING, TWO_WHEELER, WALKER, WALKING
from stand_in import StandInHub

from brickhub.hub.interface import Interface, MotorAngle, RunAngle, UntilDone, Wait
from brickhub.hub.program.generate import END_MS, WATCHDOG_MS, generate
from brickhub.hub.protocol import (
    PROTOCOL_VERSION,
    UP_PAYLOAD_BYTES,
    ByeReason,
    ControlFrame,
    DataFrame,
    Down,
    Frame,
    FrameDecoder,
    Up,
    WireFormat,
    control_frame,
    data_frame,
    parse_hello,
)
from brickhub.robot import HubKind, Motor, Robot

ARM = Robot(
    "arm",
    HubKind.TECHNIC,
    motors=(Motor("low", "D", gears=(12, 36), range_deg=(10, 70), torque_limit_mnm=900),),
)
ARM_INTERFACE = Interface((RunAngle("low", -30, 30, 250),), (MotorAngle("low", 10, 70),), Wait(250))


class Session:
    """A running program with a frame interface."""

    def __init__(self, robot: Robot, interface: Interface) -> None:
        self.hub = StandInHub(robot.hub.model.stdin_bytes)
        self.wire = WireFormat(interface, robot)
        self.decoder = FrameDecoder(self.wire.answer_bytes, UP_PAYLOAD_BYTES)
        self.program = generate(robot, interface)
        self.hub.start(self.program)
        self.first = self.run_ms(5)

    def run_ms(self, duration_ms: int) -> list[Frame]:
        return self.decoder.feed(self.hub.run_ms(duration_ms))

    def send(self, *frames: bytes) -> None:
        for frame in frames:
            self.hub.write(frame)
            self.hub.run_ms(0)

    def command(self, seq: int, *values: float) -> bytes:
        return data_frame(seq, self.wire.encode_actions(values))

    def values(self, frame: Frame) -> list[float]:
        assert isinstance(frame, DataFrame)
        return [round(float(value), 2) for value in self.wire.decode_answer(frame.payload)[1]]


@pytest.fixture
def spinning() -> Session:
    return Session(TWO_WHEELER, SPINNING)


def test_hello_at_start_and_on_request(spinning: Session) -> None:
    expected = ControlFrame(Up.HELLO, struct.pack("<BI", PROTOCOL_VERSION, spinning.program.hash))
    assert spinning.first == [expected]
    assert parse_hello(expected.payload) == (PROTOCOL_VERSION, spinning.program.hash)
    spinning.send(control_frame(Down.HELLO))
    assert spinning.run_ms(5) == [expected]
    assert spinning.hub.interrupt_byte == -1


def test_command_moves_and_is_answered_after_wait(spinning: Session) -> None:
    spinning.hub.tilt, spinning.hub.yaw_rate_deg_s = (1.234, -56.7), 123.46
    spinning.send(spinning.command(7, 30, -20))
    assert spinning.run_ms(95) == []
    (answer,) = spinning.run_ms(20)
    assert isinstance(answer, DataFrame) and answer.seq == 7
    assert spinning.hub.moves == [("run_angle", "E", 400, 30), ("run_angle", "A", 400, -20)]
    assert spinning.values(answer) == [30.0, 340.0, 1.23, -56.7, 123.5]


def test_answer_has_hub_time(spinning: Session) -> None:
    times = []
    for seq in range(1, 4):
        spinning.send(spinning.command(seq, 0, 0))
        (answer,) = spinning.run_ms(200)
        assert isinstance(answer, DataFrame)
        times.append(spinning.wire.decode_answer(answer.payload)[0])
    assert [later - earlier for earlier, later in zip(times, times[1:], strict=False)] == [200, 200]


def test_actions_are_clamped_and_rounded(spinning: Session) -> None:
    spinning.send(spinning.command(1, 1000, -3000))
    spinning.run_ms(150)
    spinning.send(spinning.command(2, 12.5, -12.6))
    spinning.run_ms(150)
    assert [move[-1] for move in spinning.hub.moves] == [100, -100, 13, -13]


def test_repeated_command_runs_once(spinning: Session) -> None:
    command = spinning.command(1, 50, 50)
    spinning.send(command)
    spinning.run_ms(50)
    spinning.send(command)  # while it is under way
    (first,) = spinning.run_ms(100)
    spinning.send(command)  # when it has been answered
    (second,) = spinning.run_ms(100)
    assert second == first
    assert len(spinning.hub.moves) == 2


def test_new_command_replaces_running_one(spinning: Session) -> None:
    spinning.send(spinning.command(1, 50, 50))
    spinning.run_ms(50)
    spinning.send(spinning.command(2, -50, -50))
    (answer,) = spinning.run_ms(300)
    assert isinstance(answer, DataFrame) and answer.seq == 2


def test_reading_moves_nothing_and_does_not_arm(spinning: Session) -> None:
    spinning.send(control_frame(Down.READ, b"\x09"))
    (answer,) = spinning.run_ms(5)
    assert isinstance(answer, DataFrame) and answer.seq == 9
    spinning.run_ms(WATCHDOG_MS * 3)
    assert spinning.hub.moves == []
    assert all(motor.stops == 0 for motor in spinning.hub.motors.values())


def test_command_with_reused_sequence_number_is_new(spinning: Session) -> None:
    spinning.send(spinning.command(5, 10, 10))
    spinning.run_ms(150)
    spinning.send(control_frame(Down.READ, b"\x06"))
    spinning.run_ms(5)
    spinning.send(spinning.command(5, 10, 10))  # 255 exchanges later
    spinning.run_ms(150)
    assert len(spinning.hub.moves) == 4


def test_a_hello_request_starts_a_new_session(spinning: Session) -> None:
    spinning.send(spinning.command(1, 50, 50))
    spinning.run_ms(20)
    spinning.send(control_frame(Down.HELLO))
    assert [type(frame) for frame in spinning.run_ms(200)] == [ControlFrame]
    assert all(motor.stops for motor in spinning.hub.motors.values())
    spinning.send(spinning.command(1, 50, 50))
    (answer,) = spinning.run_ms(150)
    assert isinstance(answer, DataFrame) and len(spinning.hub.moves) == 4


def test_silence_stops_the_motors_and_later_the_program(spinning: Session) -> None:
    spinning.send(spinning.command(1, 100, 100))
    motors = spinning.hub.motors.values()
    assert len(spinning.run_ms(WATCHDOG_MS - 2)) == 1, "the answer"
    assert not any(motor.stops for motor in motors)
    spinning.run_ms(2)
    assert [motor.stops for motor in motors] == [1, 1], (
        "counted from the host's last frame, not from the hub's answer"
    )
    spinning.run_ms(END_MS - 2)
    assert spinning.hub.running and [motor.stops for motor in motors] == [1, 1]
    assert spinning.run_ms(2) == [ControlFrame(Up.BYE, bytes([ByeReason.SILENCE]))]
    assert not spinning.hub.running


@pytest.mark.parametrize("settle", [Wait(2000), UntilDone()])
def test_silence_aborts_running_step(settle: Wait | UntilDone) -> None:
    session = Session(TWO_WHEELER, replace(RUN_AWAY, settle=settle))
    session.hub.motors["A"].blocked = True
    session.send(session.command(1, 60))
    for _ in range(4):
        assert session.run_ms(WATCHDOG_MS - 2) == []
        assert session.hub.motors["A"].stops == 0
        session.send(control_frame(Down.WATCHDOG, struct.pack("<H", WATCHDOG_MS)))  # a sign of life
    assert session.run_ms(WATCHDOG_MS - 2) == []
    assert session.hub.motors["A"].stops == 0
    assert session.run_ms(2) == [ControlFrame(Up.BYE, bytes([ByeReason.SILENCE]))], "and no answer"
    assert not session.hub.running and not session.hub.motors["A"].moving


def test_noise_does_not_reset_watchdog(spinning: Session) -> None:
    spinning.send(spinning.command(1, 100, 100))
    spinning.run_ms(110)
    noise = random.Random(1)
    for _ in range(60):
        spinning.send(bytes(noise.choices(range(256), k=15)).replace(b"\xa5", b""))
        spinning.run_ms(10)
    assert all(motor.stops for motor in spinning.hub.motors.values())


def test_command_works_after_watchdog(spinning: Session) -> None:
    spinning.send(spinning.command(1, 10, 10))
    spinning.run_ms(1000)
    spinning.send(spinning.command(2, 10, 10))
    (answer,) = spinning.run_ms(150)
    assert isinstance(answer, DataFrame) and answer.seq == 2


def test_the_host_sets_the_watchdog(spinning: Session) -> None:
    spinning.send(control_frame(Down.WATCHDOG, struct.pack("<H", 2000)))
    spinning.run_ms(5)
    spinning.send(spinning.command(1, 10, 10))
    spinning.run_ms(1900)
    assert not any(motor.stops for motor in spinning.hub.motors.values())
    spinning.run_ms(300)
    assert all(motor.stops for motor in spinning.hub.motors.values())


def test_stop_stops_the_motors_and_ends_the_program(spinning: Session) -> None:
    spinning.send(spinning.command(1, 100, 100))
    spinning.run_ms(20)
    spinning.send(control_frame(Down.STOP))
    assert spinning.run_ms(20) == [ControlFrame(Up.BYE, bytes([ByeReason.STOPPED]))]
    assert not spinning.hub.running
    assert not any(motor.moving for motor in spinning.hub.motors.values())


def test_motors_stop_when_the_program_is_stopped_from_outside(spinning: Session) -> None:
    spinning.send(spinning.command(1, 100, 100))
    spinning.run_ms(20)
    spinning.hub.stop()
    assert not any(motor.moving for motor in spinning.hub.motors.values())


def test_motors_stop_and_traceback_is_sent_on_error(spinning: Session) -> None:
    spinning.send(spinning.command(1, 100, 100))
    spinning.run_ms(20)
    spinning.hub.unplugged.add("A")
    spinning.send(spinning.command(2, 100, 100))
    text = spinning.hub.run_ms(20)
    assert b"Traceback" in text and b"ENODEV" in text
    assert not any(motor.moving for motor in spinning.hub.motors.values())


def test_reader_resyncs_after_corrupt_frames(spinning: Session) -> None:
    good = spinning.command(1, 10, 10)
    for bit in range(8 * len(good)):
        if bit // 8 == 1:
            continue  # another sequence number; the crc is what is tested here
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        spinning.send(bytes(bad))
        assert spinning.run_ms(3) == []
    assert spinning.hub.moves == []
    spinning.send(good)
    spinning.run_ms(3)
    spinning.send(good)
    answers = spinning.run_ms(150)
    assert answers and isinstance(answers[0], DataFrame) and len(spinning.hub.moves) == 2


def test_garbage_is_tolerated(spinning: Session) -> None:
    noise = random.Random(2)
    for _ in range(300):
        spinning.send(bytes(noise.choices([0xA5, 0, 72, 82, 1, 255], k=noise.randint(1, 20))))
        spinning.run_ms(4)
    spinning.hub.moves.clear()
    spinning.send(spinning.command(200, 10, 10))
    spinning.run_ms(5)
    spinning.send(spinning.command(200, 10, 10))
    answers = spinning.run_ms(200)
    assert any(isinstance(answer, DataFrame) and answer.seq == 200 for answer in answers)
    assert len(spinning.hub.moves) == 2


def test_split_frames_are_read(spinning: Session) -> None:
    for byte in spinning.command(3, 10, 10):
        spinning.send(bytes([byte]))
        spinning.run_ms(3)
    (answer,) = spinning.run_ms(150)
    assert isinstance(answer, DataFrame) and answer.seq == 3


def test_drive_base_answers_after_move() -> None:
    session = Session(TWO_WHEELER, RUN_AWAY)
    session.hub.distance_mm = 1234
    session.send(session.command(1, 60))
    assert session.run_ms(295) == []
    (answer,) = session.run_ms(12)
    assert session.hub.moves == [("straight", 60)]
    assert session.values(answer)[-1] == 1234
    assert not any(motor.stops for motor in session.hub.motors.values())


def test_blocked_move_stops_at_timeout() -> None:
    session = Session(TWO_WHEELER, RUN_AWAY)
    session.hub.motors["A"].blocked = True
    session.send(session.command(1, 60))
    for _ in range(10):
        assert session.run_ms(290) == []
        session.send(control_frame(Down.WATCHDOG, struct.pack("<H", 500)))
    (answer,) = session.run_ms(200)
    assert isinstance(answer, DataFrame)
    assert not any(motor.moving for motor in session.hub.motors.values())


def test_only_blocked_motor_stops() -> None:
    robot = Robot("pair", HubKind.CITY, motors=(Motor("one", "A"), Motor("two", "B")))
    interface = Interface(
        (RunAngle("one", -90, 90, 500), RunAngle("two", -90, 90, 500)),
        (MotorAngle("one"), MotorAngle("two")),
        UntilDone(300),
    )
    session = Session(robot, interface)
    session.hub.motors["A"].blocked = True
    session.send(session.command(1, 60, 60))
    assert session.run_ms(290) == []
    (answer,) = session.run_ms(20)
    assert session.values(answer) == [0, 60]
    assert [motor.stops for motor in session.hub.motors.values()] == [1, 0]


def test_walker_answer_fits_one_notification() -> None:
    session = Session(WALKER, WALKING)
    session.send(session.command(1, -100, -50, -25, 0))
    (answer,) = session.run_ms(300)
    assert len(session.hub.sent[-1]) == 19
    assert session.values(answer)[:4] == [260, 310, 335, 0]


def test_long_answer_is_split() -> None:
    robot = Robot(
        "many",
        HubKind.PRIME,
        motors=tuple(Motor(f"motor_{port}", port) for port in "ABCDEF"),
        needs_imu=True,
    )
    motors = [motor.name for motor in robot.motors]
    interface = Interface(
        tuple(RunAngle(name, -90, 90, 500) for name in motors),
        (*(MotorAngle(name, -1000, 1000) for name in motors), *SPINNING.channels[2:]),
        Wait(50),
    )
    session = Session(robot, interface)
    assert len(data_frame(1, bytes(session.wire.answer_bytes))) == 19 + 16, "two notifications"
    session.send(session.command(1, 1, 2, 3, 4, 5, -6))
    (answer,) = session.run_ms(100)
    assert session.values(answer)[:6] == [1, 2, 3, 4, 5, -6]
    assert [len(piece) for piece in session.hub.sent[-2:]] == [19, 16]


def test_targets_stay_in_motor_range() -> None:
    session = Session(ARM, ARM_INTERFACE)
    motor = session.hub.motors["D"]
    motor.position = 40.0
    angles = []
    for seq, delta in enumerate((30, 30, -30, -30, -30), start=1):
        session.send(session.command(seq, delta))
        (answer,) = session.run_ms(260)
        angles += session.values(answer)
    assert angles == [70, 70, 40, 10, 10]
    assert motor.gears == [12, 36] and motor.limits == {"torque": 900}


def test_sagging_joint_does_not_creep() -> None:
    session = Session(ARM, ARM_INTERFACE)
    motor = session.hub.motors["D"]
    motor.position = 40.0
    for seq in range(1, 20):
        session.send(session.command(seq, 0))
        session.run_ms(260)
        motor.position -= 2  # the load
    assert {move[-1] for move in session.hub.moves} == {40}


def test_channels_saturate_instead_of_wrapping() -> None:
    session = Session(ARM, ARM_INTERFACE)
    session.hub.motors["D"].position = 9000.0
    session.send(control_frame(Down.READ, b"\x01"))
    (answer,) = session.run_ms(5)
    assert session.values(answer) == [3276.7]
