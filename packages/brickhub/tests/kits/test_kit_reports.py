"""What virtual devices of LEGO's kits report of themselves, number by number."""

from __future__ import annotations

import struct

import pytest
from kit_world import World, encode, reports_in

from brickhub.kits.kit_protocol import (
    NOTIFICATION,
    MotorState,
    Product,
    encode_answer,
    encode_info,
    encode_notification,
)
from brickhub.kits.virtual_devices import KitDevice


@pytest.fixture
def world() -> World:
    return World()


def imu_of(world: World) -> dict[str, int]:
    """The only report of the Double Motor's IMU."""
    (imu,) = world.report(world.double, "imu")
    return imu


@pytest.mark.parametrize(
    ("battery_mv", "percent"),
    [(5900, 0), (6000, 0), (6022, 0), (6023, 1), (7150, 50), (8299, 99), (8300, 100), (8400, 100)],
)
def test_battery_is_full_at_8300_mv_and_empty_at_6000(
    world: World, battery_mv: int, percent: int
) -> None:
    world.machine.body.battery_mv = battery_mv
    assert world.report(world.color, "info") == [{"battery_pct": percent, "usb": 0}]


def test_nobody_has_a_card_or_presses_a_button(world: World) -> None:
    assert world.report(world.controller, "card") == [{"color": -1, "serial": 0}]
    assert world.report(world.controller, "button") == [{"is_pressed": 0}]
    assert world.report(world.double, "gesture") == [{"gesture": -1}]


def test_reports_come_in_their_order(world: World) -> None:
    world.double.receive(encode("notifications", 20))
    notification = world.double.outbox[-1]
    assert notification[0] == NOTIFICATION
    names = [name for name, _ in reports_in(notification)]
    assert names == ["info", "card", "button", "motor", "motor", "imu", "gesture"]
    # Message number and size come before the reports.
    assert struct.unpack_from("<BH", notification) == (60, len(notification) - 3)


def test_who_a_device_is(world: World) -> None:
    addresses = [device.address for device in (world.double, world.single, world.controller)]
    assert addresses == ["virtual-AB", "virtual-C", "virtual-controller"]
    assert world.double.name == "Double Motor"
    assert world.send(world.double, encode("uuid")) == [b"\x1brtual-AB"]
    assert world.send(world.single, encode("uuid")) == [b"\x1birtual-C"]
    assert world.send(world.controller, encode("uuid")) == [b"\x1bntroller"]


def test_information_has_versions_packet_and_product(world: World) -> None:
    versions = bytes((2, 3, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0))
    wanted = b"\x01" + versions + struct.pack("<HH", 244, 513)
    assert encode_info(Product.DOUBLE_MOTOR) == wanted
    assert world.send(world.double, encode("info")) == [wanted]
    assert encode_info(Product.COLOR_SENSOR, 20)[-4:] == struct.pack("<HH", 20, 514)


def test_answer_names_its_motors_if_it_has_any() -> None:
    assert encode_answer(139, 0, 3) == bytes((139, 3, 0))
    assert encode_answer(139, 2, 0) == bytes((139, 0, 2))
    assert encode_answer(169, 1) == bytes((169, 1))


def test_notification_of_one_report() -> None:
    assert encode_notification([("button", (1,))]) == bytes((60, 2, 0, 4, 1))


def notified_ms(world: World, device: KitDevice, until_ms: int) -> list[int]:
    """Times of the notifications that a device sends until then."""
    times_ms = []
    while world.machine.time_ms < until_ms:
        world.machine.advance(5)
        device.outbox.clear()
        device.update()
        if device.outbox:
            times_ms.append(world.machine.time_ms)
    return times_ms


def test_notifications_begin_with_their_answer_and_end_at_zero(world: World) -> None:
    device = world.color
    device.receive(encode("notifications", 30))
    assert [packet[0] for packet in device.outbox] == [41, NOTIFICATION]
    assert device.outbox[0] == bytes((41, 0))
    assert notified_ms(world, device, 100) == [30, 60, 90]
    device.receive(encode("notifications", 0))
    assert notified_ms(world, device, 200) == []


def test_new_link_begins_without_notifications_and_without_earlier_packets(world: World) -> None:
    device = world.color
    device.receive(encode("notifications", 30))
    assert len(device.outbox) == 2
    device.disconnect()
    assert not device.is_connected
    device.connect()
    assert device.is_connected
    assert device.outbox == []
    assert notified_ms(world, device, 100) == []


@pytest.mark.parametrize(
    ("force_mm_s2", "face"),
    [
        ((0.0, 0.0, 9810.0), 0),
        ((9810.0, 0.0, 0.0), 1),
        ((0.0, -9810.0, 0.0), 2),
        ((0.0, 0.0, -9810.0), 3),
        ((-9810.0, 0.0, 0.0), 4),
        ((0.0, 9810.0, 0.0), 5),
        ((5000.0, 4000.0, 7000.0), 0),
        ((7000.0, 4000.0, 5000.0), 1),
    ],
)
def test_upper_face_is_the_one_that_gravity_presses_from_below(
    world: World,
    monkeypatch: pytest.MonkeyPatch,
    force_mm_s2: tuple[float, float, float],
    face: int,
) -> None:
    monkeypatch.setattr(world.machine.body, "acceleration_mm_s2", lambda: force_mm_s2)
    assert imu_of(world)["face"] == face


def test_imu_reports_thousandths_of_g_and_whole_degrees(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = world.machine.body
    monkeypatch.setattr(body, "acceleration_mm_s2", lambda: (981.0, -1962.0, 9810.0))
    monkeypatch.setattr(body, "angular_velocity_deg_s", lambda: (1.4, -20.0, 30.6))
    monkeypatch.setattr(body, "tilt_deg", lambda: (12.4, -7.6))
    imu = imu_of(world)
    assert (imu["ax"], imu["ay"], imu["az"]) == (100, -200, 1000)
    assert (imu["gx"], imu["gy"], imu["gz"]) == (1, -20, 31)
    assert (imu["pitch"], imu["roll"]) == (12, -8)


def test_what_sixteen_bits_cannot_hold_is_the_nearest_that_they_can(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = world.machine.body
    monkeypatch.setattr(body, "angular_velocity_deg_s", lambda: (40_000.0, -40_000.0, 32_766.0))
    imu = imu_of(world)
    assert (imu["gx"], imu["gy"], imu["gz"]) == (32_767, -32_768, 32_766)


@pytest.mark.parametrize(
    ("number", "face", "yaw_deg"),
    # A turn is clockwise as it is seen on the face.
    [(0, 0, -30), (1, 1, -10), (2, 2, 20), (3, 3, 30), (4, 4, 10), (5, 5, -20), (8, 2, 20)],
)
def test_yaw_is_counted_on_the_chosen_face(
    world: World, monkeypatch: pytest.MonkeyPatch, number: int, face: int, yaw_deg: int
) -> None:
    rotation_deg = (1.0, 2.0, 3.0)
    monkeypatch.setattr(world.machine.body, "rotation_deg", lambda: rotation_deg)
    answers = world.send(world.double, encode("set_yaw_face", number))
    assert answers == [bytes((191, 0))]
    assert (imu_of(world)["yaw_face"], imu_of(world)["yaw"]) == (face, 0)
    rotation_deg = (11.0, 22.0, 33.0)
    assert imu_of(world)["yaw"] == yaw_deg


@pytest.mark.parametrize(
    ("yaw_deg", "turned_deg", "reported_deg"),
    [(0, 179, 179), (0, 180, -180), (0, 181, -179), (0, -180, -180), (0, -181, 179), (90, 300, 30)],
)
def test_yaw_wraps_at_half_a_turn(
    world: World,
    monkeypatch: pytest.MonkeyPatch,
    yaw_deg: int,
    turned_deg: int,
    reported_deg: int,
) -> None:
    assert world.send(world.double, encode("reset_yaw", yaw_deg)) == [bytes((193, 0))]
    monkeypatch.setattr(world.machine.body, "rotation_deg", lambda: (0.0, 0.0, -turned_deg))
    assert imu_of(world)["yaw"] == reported_deg


def test_new_link_counts_the_yaw_from_zero(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world.machine.body, "rotation_deg", lambda: (0.0, 0.0, -50.0))
    assert imu_of(world)["yaw"] == 50
    world.double.connect()
    assert imu_of(world)["yaw"] == 0


@pytest.mark.parametrize(
    ("angle_mdeg", "absolute_deg"),
    [(0, 0), (999, 0), (359_999, 359), (360_000, 0), (-1, 359), (-90_000, 270), (725_500, 5)],
)
def test_absolute_position_is_within_a_turn(
    world: World, monkeypatch: pytest.MonkeyPatch, angle_mdeg: int, absolute_deg: int
) -> None:
    monkeypatch.setattr(world.machine.body, "angle_mdeg", lambda port: angle_mdeg)
    (motor,) = world.report(world.single, "motor")
    assert motor["absolute"] == absolute_deg


@pytest.mark.parametrize(
    ("duty", "power", "state"),
    [
        (5000, 5000, MotorState.DUTY),
        (-2500, -2500, MotorState.DUTY),
        (10_000, 10_000, MotorState.DUTY),
        # A servo takes whole percent, towards zero.
        (199, 100, MotorState.DUTY),
        (-199, -100, MotorState.DUTY),
        (99, 0, MotorState.READY),
    ],
)
def test_duty_is_a_share_of_the_battery(world: World, duty: int, power: int, state: int) -> None:
    world.machine.body.battery_mv = 8000
    assert world.send(world.single, encode("set_duty", 1, duty), ms=5) == [bytes((133, 1, 0))]
    (motor,) = world.report(world.single, "motor")
    assert (motor["power"], motor["state"]) == (power, state)


def test_motors_of_a_pair_have_their_bits(world: World) -> None:
    motors = world.report(world.double, "motor")
    assert [motor["motors"] for motor in motors] == [1, 2]
    assert [motor["gesture"] for motor in motors] == [-1, -1]


def test_blocked_motor_reports_its_stall() -> None:
    world = World(end_stops={"C": (-30.0, 30.0)})
    world.send(world.single, encode("run", 1, 0), ms=1000)
    (motor,) = world.report(world.single, "motor")
    assert motor["state"] == MotorState.STALLED
    assert motor["position"] == pytest.approx(30, abs=2)


def test_running_motor_reports_its_speed_in_percent(world: World) -> None:
    world.send(world.single, encode("set_speed", 1, 30), encode("run", 1, 0), ms=1000)
    (motor,) = world.report(world.single, "motor")
    assert motor["state"] == MotorState.RUNNING
    assert motor["speed"] == pytest.approx(30, abs=1)


@pytest.mark.parametrize(
    ("reading", "raw", "percent"),
    # What is white reflects all of 10 bits, and three times 1024 are 100 %.
    [("white", 255, 100), ("none", 0, 0)],
)
def test_ends_of_the_light(reading: str, raw: int, percent: int) -> None:
    world = World(f"D={reading}")
    (seen,) = world.report(world.color, "color")
    assert (seen["red"], seen["green"], seen["blue"]) == (raw, raw, raw)
    assert (seen["saturation"], seen["value"], seen["reflection"]) == (0, percent, percent)


def test_color_has_raw_light_and_hue() -> None:
    """Of a full red SPIKE's sensor sends a third of the light: 1024 of 3072."""
    world = World("D=0,100,100")
    (seen,) = world.report(world.color, "color")
    assert (seen["red"], seen["green"], seen["blue"]) == (255, 0, 0)
    assert seen["reflection"] == 33
    assert (seen["saturation"], seen["value"], seen["mode"]) == (100, 100, 1)


@pytest.mark.parametrize(
    ("hue", "number"),
    [(300, 1), (270, 2), (240, 3), (200, 4), (170, 5), (120, 6), (60, 7), (30, 8), (0, 9)],
)
def test_numbers_of_colors(hue: int, number: int) -> None:
    world = World(f"D={hue},100,100")
    (seen,) = world.report(world.color, "color")
    assert seen["color"] == number


@pytest.mark.parametrize(("mode", "value"), [(2, 37), (0, 0), (3, 0)])
def test_sensor_that_does_not_detect_sees_at_most_the_light_around(mode: int, value: int) -> None:
    world = World("D=red", "D.ambient=37%")
    assert world.send(world.color, encode("set_color_mode", mode)) == [bytes((201, 0))]
    (seen,) = world.report(world.color, "color")
    dark = ("reflection", "red", "green", "blue", "hue", "saturation")
    assert [seen[name] for name in dark] == [0] * 6
    assert (seen["color"], seen["value"], seen["mode"]) == (-1, value, mode)
