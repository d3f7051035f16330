"""Hubs and sensors as LEGO and Pybricks publish them."""

from __future__ import annotations

import pytest

from brickhub.robot import HubKind, KitKind, MotorKind, Sense, SensorKind
from brickhub.robot.hardware import REMOTE_BUTTONS, USUAL_HUB_NAME, port_name

# Product ids: "System Type and Device Number" of LEGO's wireless protocol, and Pybricks'
# `pbio/protocol.h` for what is newer.
PRODUCTS = {
    HubKind.MOVE: 0x40,
    HubKind.CITY: 0x41,
    HubKind.TECHNIC: 0x80,
    HubKind.PRIME: 0x81,
    HubKind.ESSENTIAL: 0x83,
    HubKind.EV3: 0xE2,
    KitKind.SINGLE_MOTOR: 512,
    KitKind.DOUBLE_MOTOR: 513,
}
PORTS = {
    HubKind.MOVE: "ABCD",
    HubKind.CITY: "AB",
    HubKind.TECHNIC: "ABCD",
    HubKind.PRIME: "ABCDEF",
    HubKind.ESSENTIAL: "AB",
    HubKind.EV3: "ABCD1234",
    KitKind.SINGLE_MOTOR: "ABCDEF",
    KitKind.DOUBLE_MOTOR: "ABCDEF",
}
HUBS = list(HubKind)


def having(**properties: object) -> list[HubKind]:
    """Hubs with such properties."""
    found = []
    for kind in HUBS:
        if all(getattr(kind.model, name) == value for name, value in properties.items()):
            found.append(kind)
    return found


@pytest.mark.parametrize(("kind", "product_id"), PRODUCTS.items(), ids=str)
def test_hubs_identify_themselves_by_published_numbers(
    kind: HubKind | KitKind, product_id: int
) -> None:
    assert kind.model.product_id == product_id


@pytest.mark.parametrize(("kind", "ports"), PORTS.items(), ids=str)
def test_ports_of_hubs(kind: HubKind | KitKind, ports: str) -> None:
    assert kind.model.ports == ports


def test_what_each_hub_has() -> None:
    prime, essential, technic = HubKind.PRIME, HubKind.ESSENTIAL, HubKind.TECHNIC
    city, move, ev3 = HubKind.CITY, HubKind.MOVE, HubKind.EV3
    assert having(has_imu=True) == [prime, essential, technic]
    assert having(has_accelerometer=True) == [move]
    assert having(has_float=False) == [move]
    assert having(has_display=True) == [prime]
    assert having(has_speaker=True) == [prime, ev3]
    assert having(is_rechargeable=True) == [prime, essential]
    assert having(has_bluetooth=False) == [ev3]
    assert having(has_hub_network=True) == [prime, essential]
    assert having(ran_pybricks_2=True) == [ev3]
    assert having(peripherals=2) == [prime, essential]
    assert having(peripherals=1) == [technic, city, move]
    assert having(peripherals=0) == [ev3]
    assert having(screen_pixels=None) == [prime, essential, technic, city, move]
    assert ev3.model.screen_pixels == (178, 128)
    assert all(kind.model.runs_programs for kind in HubKind)
    assert not any(kind.model.runs_programs for kind in KitKind)


def test_buttons_of_hubs() -> None:
    assert HubKind.PRIME.model.buttons == ("center", "left", "right", "bluetooth")
    assert HubKind.EV3.model.buttons == ("center", "left", "right", "up", "down", "left_up")
    assert having(buttons=("center",)) == [
        HubKind.ESSENTIAL,
        HubKind.TECHNIC,
        HubKind.CITY,
        HubKind.MOVE,
    ]
    assert {kind.model.stop_button for kind in HubKind} == {"center", "left_up"}
    assert HubKind.EV3.model.stop_button == "left_up"
    assert [kind.model.buttons for kind in KitKind] == [(), ()]
    assert len(REMOTE_BUTTONS) == 7


@pytest.mark.parametrize(
    ("kind", "program_kib", "stdin_bytes", "packet_bytes"),
    # `pbdrvconfig.h` of Pybricks 4: slots of the flash memory, ring buffers, packets less 3.
    [
        (HubKind.PRIME, 272, 63, 515 - 3),
        (HubKind.ESSENTIAL, 258, 63, 515 - 3),
        (HubKind.TECHNIC, 32, 20, 158 - 3),
        (HubKind.CITY, 20, 20, 158 - 3),
        (HubKind.MOVE, 7, 0, 0),
    ],
)
def test_memory_of_hubs(
    kind: HubKind, program_kib: int, stdin_bytes: int, packet_bytes: int
) -> None:
    model = kind.model
    assert model.program_bytes == 1024 * program_kib
    assert model.memory_bytes == model.program_bytes
    assert (model.stdin_bytes, model.packet_bytes) == (stdin_bytes, packet_bytes)


def test_memory_of_an_ev3_is_more_than_its_programs() -> None:
    model = HubKind.EV3.model
    assert model.memory_bytes == 1024 * 1024 > model.program_bytes


def test_stored_data_is_larger_on_hubs_with_flash_of_their_own() -> None:
    kept = {kind: kind.model.storage_bytes for kind in HubKind}
    large = [kind for kind, size in kept.items() if size == 512]
    assert large == [HubKind.PRIME, HubKind.ESSENTIAL, HubKind.EV3]
    assert {kept[kind] for kind in HUBS if kind not in large} == {128}
    # User data, then settings and what is known of slots.
    assert all(kind.model.stored_bytes > kind.model.storage_bytes for kind in HubKind)


def test_times_of_products_are_in_proportion_to_the_clocks() -> None:
    clock_mhz = {HubKind.PRIME: 96, HubKind.TECHNIC: 80, HubKind.CITY: 48}
    cycles = [clock_mhz[kind] * kind.model.product_us for kind in clock_mhz]
    assert max(cycles) < 1.3 * min(cycles)


def test_hubs_with_motors_of_their_own() -> None:
    assert (HubKind.MOVE.model.own_motors, HubKind.MOVE.model.own_kind) == ("AB", "move-hub")
    assert KitKind.DOUBLE_MOTOR.model.own_motors == "AB"
    assert KitKind.SINGLE_MOTOR.model.own_motors == "A"
    assert not KitKind.SINGLE_MOTOR.model.has_imu
    assert KitKind.DOUBLE_MOTOR.model.has_imu
    assert HubKind.MOVE.model.ports_for_sensors == "CD"
    assert HubKind.PRIME.model.ports_for_sensors == "ABCDEF"
    assert HubKind.EV3.model.ports_for_sensors == "1234"
    assert HubKind.EV3.model.motor_ports == "ABCD"


def test_ports_of_an_ev3_have_names_in_programs() -> None:
    assert [port_name(port) for port in "AD14"] == ["A", "D", "S1", "S4"]
    assert HubKind.EV3.model.port_aliases == (("E", "1"), ("F", "2"))


def test_hubs_have_classes_and_other_names() -> None:
    classes = {kind.model.class_name for kind in HubKind}
    assert classes == {
        "PrimeHub",
        "EssentialHub",
        "TechnicHub",
        "CityHub",
        "MoveHub",
        "EV3Brick",
    }
    # The same hub was sold as Robot Inventor, and programs for a Prime hub run on an EV3.
    aliases = {kind: kind.model.alias for kind in HubKind if kind.model.alias}
    assert aliases == {HubKind.PRIME: "InventorHub", HubKind.EV3: "PrimeHub"}
    assert USUAL_HUB_NAME == "Pybricks Hub"


# LEGO's description of its wireless protocol ("IO type ID"), and `lego/device.h` of Pybricks.
SENSORS = {
    SensorKind.LIGHT: 8,
    SensorKind.TILT: 34,
    SensorKind.INFRARED: 35,
    SensorKind.COLOR_DISTANCE: 37,
    SensorKind.COLOR: 61,
    SensorKind.ULTRASONIC: 62,
    SensorKind.FORCE: 63,
    SensorKind.COLOR_LIGHT_MATRIX: 64,
    SensorKind.EV3_COLOR: 29,
    SensorKind.EV3_ULTRASONIC: 30,
    SensorKind.EV3_GYRO: 32,
    SensorKind.EV3_INFRARED: 33,
}


@pytest.mark.parametrize(("kind", "number"), SENSORS.items(), ids=str)
def test_sensors_introduce_themselves_by_published_numbers(kind: SensorKind, number: int) -> None:
    assert kind.model.device_id == number


@pytest.mark.parametrize(
    ("kind", "senses", "readings"),
    [
        (SensorKind.COLOR, ["surface", "ambient"], ["reflection", "ambient", "hsv"]),
        (
            SensorKind.COLOR_DISTANCE,
            ["surface", "distance", "ambient"],
            ["reflection", "ambient", "hsv", "distance"],
        ),
        (SensorKind.FORCE, ["force"], ["force", "distance", "pressed", "touched"]),
        (SensorKind.INFRARED, ["distance", "count"], ["reflection", "distance", "count"]),
        (SensorKind.TILT, ["tilt"], ["tilt"]),
        (SensorKind.ULTRASONIC, ["distance"], []),
        (SensorKind.LIGHT, [], []),
        (SensorKind.EV3_TOUCH, ["force"], ["pressed"]),
        (SensorKind.EV3_COLOR, ["surface", "ambient"], ["reflection", "ambient", "rgb"]),
        (SensorKind.EV3_GYRO, ["rotation"], ["angle", "speed"]),
        (SensorKind.EV3_INFRARED, ["distance", "beacon"], ["distance"]),
    ],
)
def test_what_sensors_sense_and_their_methods_return(
    kind: SensorKind, senses: list[str], readings: list[str]
) -> None:
    assert [str(sense) for sense in kind.model.senses] == senses
    assert list(kind.model.readings) == readings
    assert all(sense in set(Sense) for sense in senses)


def test_ranges_and_lights_of_sensors() -> None:
    ranges = {kind: kind.model.range_mm for kind in SensorKind if kind.model.range_mm}
    assert ranges == {
        # "50 - 2000 mm" in LEGO's data sheet, from 40 in its fast mode; "3 - 250 cm", to 255.
        SensorKind.ULTRASONIC: (40, 2000),
        SensorKind.EV3_ULTRASONIC: (30, 2550),
    }
    lights = {kind: kind.model.light for kind in SensorKind if kind.model.light}
    assert lights == {SensorKind.ULTRASONIC: "lights.on", SensorKind.LIGHT: "on"}


def test_classes_of_devices_in_their_modules() -> None:
    of_ev3 = {kind.model.class_name for kind in SensorKind if kind.model.module == "ev3devices"}
    assert of_ev3 == {
        "TouchSensor",
        "ColorSensor",
        "UltrasonicSensor",
        "GyroSensor",
        "InfraredSensor",
    }
    plain = [kind for kind in MotorKind if not kind.model.has_encoder]
    assert plain == [MotorKind.MEDIUM_LINEAR, MotorKind.TRAIN]
    assert {kind.model.class_name for kind in plain} == {"DCMotor"}
    others = {kind.model.class_name for kind in MotorKind if kind not in plain}
    assert others == {"Motor"}


def test_motors_that_know_their_angle_after_plugging_in() -> None:
    """Those of SPIKE and Technic have an absolute sensor, but for the interactive one and those of
    the EV3."""
    without = [kind for kind in MotorKind if not kind.model.is_absolute]
    assert without == [
        MotorKind.INTERACTIVE,
        MotorKind.MOVE_HUB,
        MotorKind.EV3_LARGE,
        MotorKind.EV3_MEDIUM,
        MotorKind.NXT,
    ]
    two_sided = [kind for kind in MotorKind if kind.model.is_two_sided]
    assert two_sided == [MotorKind.EV3_LARGE, MotorKind.NXT]


def test_motors_that_are_others_in_another_colour() -> None:
    likes = {kind.model.name: kind.model.like for kind in MotorKind if kind.model.like}
    names = {kind.model.name for kind in MotorKind}
    assert likes == {
        "technic-m-angular": "spike-medium",
        "technic-l-angular": "spike-large",
        "medium-linear": "technic-l",
        "train": "technic-l",
        "nxt-motor": "ev3-large",
    }
    assert set(likes.values()) <= names


def test_wrong_name_of_a_kind_is_told_with_the_right_ones() -> None:
    says = r"there is no HubKind.PRYME \(did you mean 'PRIME'\?\); choose PRIME, ESSENTIAL, TECHNIC"
    with pytest.raises(AttributeError, match=says):
        _ = HubKind.PRYME
    with pytest.raises(AttributeError, match="^_odd$"):
        _ = HubKind._odd
    assert HubKind("prime") is HubKind.PRIME
    assert HubKind.PRIME.value == "prime"


def test_calls_that_a_stack_holds() -> None:
    """Most on an EV3, whose memory of 64 MiB is another league; fewest on a Move Hub."""
    depths = {kind: kind.model.stack_bytes // kind.model.call_bytes for kind in HubKind}
    *others, largest = sorted(depths, key=lambda kind: depths[kind])
    assert (others[0], largest) == (HubKind.MOVE, HubKind.EV3)
    assert depths[HubKind.EV3] > 100 * max(depths[kind] for kind in others)
    assert depths[HubKind.EV3] * HubKind.EV3.model.call_bytes < 64 * 1024 * 1024
    # A call's frame is much the same on all of them, which have 32 bits.
    assert all(200 <= kind.model.call_bytes <= 240 for kind in HubKind)
