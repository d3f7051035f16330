"""What LEGO's devices send for what they sense, to the last digit, and where their ranges end."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.robot import MotorKind, SensorKind
from brickhub.virtual.pybricks.device_modes import MODES
from brickhub.virtual.pybricks.ev3.ev3_modes import RGB_SCALES
from brickhub.virtual.pybricks.plug import Plug, _hsv_of_bytes


class Surroundings:
    """A machine as far as a device on a port of it looks: what is sensed, and when."""

    def __init__(self) -> None:
        self.stimuli: dict[str, Any] = {}
        self.time_ms = 0
        self.angle = 0
        self.distance = 2000
        self.down: frozenset[str] = frozenset()
        self.body = SimpleNamespace(
            sensed=lambda port, sense: self.stimuli[str(sense)],
            distance_mm=lambda port: self.distance,
            angle_mdeg=lambda port: self.angle,
        )
        self.panel = SimpleNamespace(pressed_on=lambda device, time_ms: self.down)
        self.servos = {"A": SimpleNamespace(type=SimpleNamespace(max_speed_deg_s=1000))}


def plug(**stimuli: Any) -> Plug:
    """A device that senses this."""
    machine = Surroundings()
    machine.stimuli = stimuli
    return Plug(machine, "A")  # type: ignore[arg-type]


def sent(
    kind: SensorKind | MotorKind,
    mode: str,
    surroundings: Surroundings | None = None,
    **stimuli: Any,
) -> tuple[int, ...]:
    """What a kind of device sends in one of its modes."""
    machine = surroundings or Surroundings()
    machine.stimuli = stimuli
    modes = MODES[kind.model.device_id].modes
    (found,) = [one for one in modes if one.name == mode]
    return found.values(Plug(machine, "A"))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("distance_pct", "tenths"),
    [
        (-5, 0),
        (0, 0),
        (4.9, 0),
        (5.1, 1),
        (14.9, 1),
        (54, 5),
        (56, 6),
        (94, 9),
        (96, 10),
        (130, 10),
    ],
)
def test_proximity_is_in_tenths_from_0_to_10(distance_pct: float, tenths: int) -> None:
    assert plug(distance=distance_pct).proximity() == tenths


@pytest.mark.parametrize(
    ("distance_pct", "raw"),
    [(0, 500), (1, 500), (2, 500), (2.2, 490), (10, 100), (50, 12), (99, 1), (100, 1), (400, 1)],
)
def test_infrared_light_is_1100_by_the_distance_less_10(distance_pct: float, raw: int) -> None:
    assert plug(distance=distance_pct).infrared_raw() == raw


@pytest.mark.parametrize(
    ("newtons", "millinewtons"),
    [
        (-1, 0),
        (0, 0),
        (0.0004, 0),
        (0.0006, 1),
        (2.5, 2500),
        (9.9994, 9999),
        (10, 10_000),
        (11, 10_000),
    ],
)
def test_force_ends_at_10_newtons(newtons: float, millinewtons: int) -> None:
    assert plug(force=newtons).force_mn() == millinewtons


@pytest.mark.parametrize(
    ("tilt", "told"),
    [
        ((10.4, -5.6), (10, -6)),
        ((44.4, -44.4), (44, -44)),
        ((45.6, -45.6), (45, -45)),
        ((-90, 90), (-45, 45)),
    ],
)
def test_tilt_ends_at_45_degrees(tilt: tuple[float, float], told: tuple[int, int]) -> None:
    assert plug(tilt=tilt).tilt_deg() == told


def test_speed_is_the_mean_since_the_last_look() -> None:
    """In percent of the motor's largest speed, here 1000 degrees a second."""
    machine = Surroundings()
    device = Plug(machine, "A")  # type: ignore[arg-type]
    seen = []
    looks = (
        (100, 7_000),
        (200, 57_000),
        (200, 57_000),
        (300, 57_000),
        (400, 156_000),
        (500, 400_000),
        (600, 57_000),
        (800, 55_000),
        (802, 55_017),
    )
    for time_ms, angle_mdeg in looks:
        machine.time_ms, machine.angle = time_ms, angle_mdeg
        seen.append(device.speed_pct())
    assert seen == [0, 50, 0, 0, 99, 100, -100, -1, 1]


@pytest.mark.parametrize(
    ("rgb", "hsv"),
    [
        ((0, 0, 0), (10, 0, 0)),
        ((10, 10, 10), (10, 0, 3)),
        ((255, 255, 255), (10, 0, 100)),
        ((128, 127, 127), (10, 0, 50)),
        ((255, 0, 0), (10, 100, 100)),
        ((255, 0, 10), (6, 100, 100)),
        ((200, 50, 100), (340, 75, 78)),
        ((200, 100, 50), (30, 75, 78)),
        ((255, 128, 0), (40, 100, 100)),
        ((200, 200, 0), (60, 100, 78)),
        ((100, 200, 50), (100, 75, 78)),
        ((0, 255, 0), (120, 100, 100)),
        ((50, 200, 100), (140, 75, 78)),
        ((0, 200, 200), (180, 100, 78)),
        ((50, 100, 200), (220, 75, 78)),
        ((0, 0, 255), (240, 100, 100)),
        ((100, 50, 200), (260, 75, 78)),
        ((200, 0, 200), (300, 100, 78)),
    ],
)
def test_color_of_three_bytes(rgb: tuple[int, int, int], hsv: tuple[int, int, int]) -> None:
    """By hand, with the integers of ``pb_color_map_rgb_to_hsv``: a chroma of 0 has the hue of red,
    which is shifted to 10; the value is 101/256 of the largest byte."""
    assert _hsv_of_bytes(*rgb) == hsv


@pytest.mark.parametrize(
    ("surface", "raw"),
    [
        ((0, 0, 0), (0, 0, 0)),
        ((0, 0, 100), (440, 440, 440)),
        ((0, 100, 100), (440, 0, 0)),
        ((120, 50, 75), (110, 220, 110)),
        ((300, 75, 36), (88, 22, 88)),
    ],
)
def test_raw_light_of_the_boost_sensor(
    surface: tuple[int, int, int], raw: tuple[int, int, int]
) -> None:
    """Of a value v the firmware makes v * (200 - v) / 100: 75 of 50, and 36 of 20."""
    device = plug(surface=surface)
    assert device.raw_rgb(is_boost=True) == raw
    seen = device.reflected_hsv(is_boost=True)
    assert seen[1:] == pytest.approx(surface[1:], abs=1)
    assert sent(SensorKind.COLOR_DISTANCE, "RGB I", surface=surface) == raw


@pytest.mark.parametrize(
    ("surface", "raw", "read"),
    [
        ((0, 0, 0), (0, 0, 0), (10, 0, 0)),
        ((0, 0, 100), (1024, 1024, 1024), (10, 0, 100)),
        ((120, 100, 100), (0, 1024, 0), (120, 100, 100)),
        ((240, 75, 72), (307, 307, 614), (240, 75, 72)),
        ((240, 75, 52), (205, 205, 410), (240, 75, 52)),
    ],
)
def test_raw_light_of_the_spike_sensor(
    surface: tuple[int, int, int], raw: tuple[int, int, int], read: tuple[int, int, int]
) -> None:
    """Of a value v the firmware makes v * (150 - v / 2) / 100, of a saturation s
    s * (200 - s) / 100: 72 of 60, 52 of 40, 75 of 50."""
    device = plug(surface=surface)
    assert device.raw_rgb(is_boost=False) == raw
    assert device.reflected_hsv(is_boost=False) == read
    assert sent(SensorKind.COLOR, "RGB I", surface=surface) == (*raw, 0)


@pytest.mark.parametrize("is_boost", [True, False])
@pytest.mark.parametrize("hue", [70, 120, 200, 300, 340])
def test_a_program_reads_the_color_that_is_there(is_boost: bool, hue: int) -> None:
    """Up to the bytes in which the firmware computes."""
    for saturation in (0, 30, 60, 90, 100):
        for value in (40, 60, 80, 100):
            seen = plug(surface=(hue, saturation, value)).reflected_hsv(is_boost)
            assert seen[1] == pytest.approx(saturation, abs=3)
            assert seen[2] == pytest.approx(value, abs=2)
            if saturation >= 30:
                assert seen[0] == pytest.approx(hue, abs=4)


@pytest.mark.parametrize(
    ("surface", "spike", "boost"),
    [
        ((0, 100, 100), 9, 9),
        ((0, 0, 100), 10, 10),
        ((60, 100, 100), 7, 7),
        ((120, 100, 100), 5, 5),
        ((180, 100, 100), 4, 4),
        ((240, 100, 100), 3, 3),
        ((0, 0, 10), 0, 0),
        ((0, 0, 0), -1, -1),
    ],
)
def test_numbers_of_legos_colors(surface: tuple[int, int, int], spike: int, boost: int) -> None:
    assert sent(SensorKind.COLOR, "COLOR", surface=surface) == (spike,)
    assert sent(SensorKind.COLOR_DISTANCE, "COLOR", surface=surface) == (boost,)


@pytest.mark.parametrize(
    ("kind", "mode", "stimuli", "values"),
    [
        (SensorKind.COLOR, "HSV", {"surface": (120, 80, 50)}, (120, 800, 500)),
        (SensorKind.COLOR, "SHSV", {"ambient": (30, 7, 9)}, (30, 70, 90, 0)),
        (SensorKind.COLOR, "REFLT", {"surface": (0, 0, 40)}, (40,)),
        (SensorKind.COLOR, "REFLT", {"surface": (0, 100, 100)}, (33,)),
        (SensorKind.COLOR, "AMBI", {"ambient": 30.6}, (31,)),
        (SensorKind.COLOR, "AMBI", {"ambient": 130.0}, (100,)),
        (SensorKind.COLOR, "LIGHT", {}, (0, 0, 0)),
        (SensorKind.COLOR, "CALIB", {}, (0,) * 7),
        (SensorKind.COLOR_DISTANCE, "PROX", {"distance": 54}, (5,)),
        (SensorKind.COLOR_DISTANCE, "REFLT", {"surface": (0, 100, 60)}, (20,)),
        (SensorKind.COLOR_DISTANCE, "AMBI", {"ambient": 12.4}, (12,)),
        (SensorKind.FORCE, "FORCE", {"force": 2.5}, (25,)),
        (SensorKind.FORCE, "FORCE", {"force": 2.59}, (25,)),
        (SensorKind.FORCE, "FORCE", {"force": 12.0}, (100,)),
        (SensorKind.FORCE, "TOUCH", {"force": 0.0}, (0,)),
        (SensorKind.FORCE, "TOUCH", {"force": 0.001}, (1,)),
        (SensorKind.FORCE, "FRAW", {"force": 0.0}, (384,)),
        (SensorKind.FORCE, "FRAW", {"force": 5.0}, (542,)),
        (SensorKind.FORCE, "FRAW", {"force": 10.0}, (701,)),
        (SensorKind.FORCE, "CALIB", {}, (0, 0, 384, 0, 0, 0, 701, 0)),
        (SensorKind.TILT, "LPF2-ANGLE", {"tilt": (10, -20)}, (-20, 10)),
        (SensorKind.INFRARED, "LPF2-DETECT", {"distance": 96}, (10,)),
        (SensorKind.INFRARED, "LPF2-COUNT", {"count": 3.9}, (3,)),
        (SensorKind.INFRARED, "LPF2-CAL", {"distance": 10}, (100, 0, 0)),
        (SensorKind.COLOR_LIGHT_MATRIX, "PIX O", {}, (0,) * 9),
    ],
)
def test_values_of_a_mode(
    kind: SensorKind, mode: str, stimuli: dict[str, Any], values: tuple[int, ...]
) -> None:
    assert sent(kind, mode, **stimuli) == values


@pytest.mark.parametrize(
    ("distance_mm", "long", "short", "echo_us"),
    [
        (40, 40, 40, 233),
        (320, 320, 320, 1866),
        (321, 321, -1, 1872),
        (343, 343, -1, 2000),
        (1999, 1999, -1, 11656),
        (2000, -1, -1, 14577),
        (2550, -1, -1, 14577),
    ],
)
def test_distances_of_the_ultrasonic_sensor(
    distance_mm: int, long: int, short: int, echo_us: int
) -> None:
    """An echo takes the time of sound there and back, 0.343 mm a microsecond."""
    machine = Surroundings()
    machine.distance = distance_mm
    kind = SensorKind.ULTRASONIC
    assert sent(kind, "DISTL", machine) == sent(kind, "SINGL", machine) == (long,)
    assert sent(kind, "DISTS", machine) == (short,)
    assert sent(kind, "TRAW", machine) == (echo_us,)


@pytest.mark.parametrize(
    ("angle_mdeg", "position", "absolute", "calibrated"),
    [
        (0, 0, 0, 0),
        (999, 0, 0, 9),
        (1000, 1, 1, 10),
        (-1, -1, -1, 3599),
        (90_000, 90, 90, 900),
        (179_999, 179, 179, 1799),
        (180_000, 180, -180, 1800),
        (359_999, 359, -1, 3599),
        (360_000, 360, 0, 0),
        (-180_000, -180, -180, 1800),
        (-180_001, -181, 179, 1799),
        (890_000, 890, 170, 1700),
    ],
)
def test_angles_of_a_motor(angle_mdeg: int, position: int, absolute: int, calibrated: int) -> None:
    machine = Surroundings()
    machine.angle = angle_mdeg
    kind = MotorKind.SPIKE_LARGE
    assert sent(kind, "POS", machine) == (position,)
    assert sent(kind, "APOS", machine) == (absolute,)
    assert sent(kind, "CALIB", machine) == (0, calibrated)
    assert sent(MotorKind.INTERACTIVE, "POS", machine) == (position,)


def test_speed_of_a_motor_in_its_own_mode() -> None:
    for kind in (MotorKind.SPIKE_LARGE, MotorKind.INTERACTIVE):
        machine = Surroundings()
        machine.time_ms = 5
        assert sent(kind, "SPEED", machine) == (0,), "nothing to compare with"


def test_motors_begin_where_the_firmware_reads_their_angle() -> None:
    def first(kind: MotorKind | SensorKind) -> str:
        return MODES[kind.model.device_id].first_mode

    assert first(MotorKind.SPIKE_LARGE) == "CALIB"
    assert first(MotorKind.INTERACTIVE) == "POS"
    assert first(SensorKind.COLOR_DISTANCE) == "RGB I"
    assert first(SensorKind.COLOR) == "COLOR"
    assert first(SensorKind.LIGHT) == ""


@pytest.mark.parametrize(
    ("kind", "mode", "stale_ms"),
    [
        (SensorKind.COLOR, "COLOR", 30),
        (SensorKind.COLOR, "LIGHT", 0),
        (SensorKind.COLOR_DISTANCE, "PROX", 30),
        (SensorKind.COLOR_DISTANCE, "IR Tx", 0),
        (SensorKind.ULTRASONIC, "DISTL", 50),
        (SensorKind.ULTRASONIC, "LIGHT", 0),
        (SensorKind.FORCE, "FRAW", 0),
        (SensorKind.TILT, "LPF2-ANGLE", 0),
        (SensorKind.EV3_COLOR, "RGB-RAW", 30),
        (SensorKind.EV3_INFRARED, "IR-SEEK", 1100),
        (SensorKind.EV3_GYRO, "GYRO-ANG", 0),
    ],
)
def test_values_are_stale_after_a_change_of_mode(
    kind: SensorKind, mode: str, stale_ms: int
) -> None:
    """As the firmware waits (``lego_device_stale_data_delay``); no light sends anything."""
    assert MODES[kind.model.device_id].stale_ms(mode) == stale_ms


# ---- EV3


@pytest.mark.parametrize(
    ("surface", "number"),
    [
        ((0, 0, 0), 0),
        ((0, 0, 10), 1),
        ((240, 100, 100), 2),
        ((120, 100, 100), 3),
        ((60, 100, 100), 4),
        ((0, 100, 100), 5),
        ((0, 0, 100), 6),
        ((30, 100, 50), 7),
    ],
)
def test_numbers_of_colors_on_an_ev3(surface: tuple[int, int, int], number: int) -> None:
    assert sent(SensorKind.EV3_COLOR, "COL-COLOR", surface=surface) == (number,)


@pytest.mark.parametrize(
    ("surface", "percent"),
    [
        ((0, 100, 80), 80),
        ((120, 100, 80), 0),
        ((0, 0, 55), 55),
        ((60, 50, 40), 40),
        ((180, 50, 40), 20),
    ],
)
def test_an_ev3_sees_red_light_reflected(surface: tuple[int, int, int], percent: int) -> None:
    assert sent(SensorKind.EV3_COLOR, "COL-REFLECT", surface=surface) == (percent,)


@pytest.mark.parametrize("hue", [0, 120, 240])
def test_percents_of_red_green_and_blue_are_those_of_the_surface(hue: int) -> None:
    """The firmware makes them of the raw values, by a factor and an offset (v4)."""
    for value in range(101):
        raw = sent(SensorKind.EV3_COLOR, "RGB-RAW", surface=(hue, 100, value))
        percents = [
            max(0, math.trunc(factor * one - offset))
            for one, (factor, offset) in zip(raw, RGB_SCALES, strict=True)
        ]
        expected = [0, 0, 0]
        expected[hue // 120] = value
        assert percents == expected
        assert raw[(hue // 120 + 1) % 3] == 0


@pytest.mark.parametrize(
    ("seen", "direction", "distance_pct"),
    [
        ((), 0, -128),
        ((40.4, 0.0), 0, 40),
        ((40.6, 31.0), 10, 41),
        ((-1.0, -31.0), -10, 0),
        ((101.0, 76.0), 25, 100),
        ((100.0, -80.0), -25, 100),
        ((0.0, 72.0), 24, 0),
    ],
)
def test_direction_of_a_beacon_is_in_thirds_up_to_75_degrees(
    seen: tuple[float, ...], direction: int, distance_pct: int
) -> None:
    values = sent(SensorKind.EV3_INFRARED, "IR-SEEK", beacon=seen)
    assert values == (direction, distance_pct, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("distance_pct", "sent_pct"), [(-3, 0), (0, 0), (49.6, 50), (100, 100), (101, 100)]
)
def test_infrared_distance_of_an_ev3(distance_pct: float, sent_pct: int) -> None:
    assert sent(SensorKind.EV3_INFRARED, "IR-PROX", distance=distance_pct) == (sent_pct,)


@pytest.mark.parametrize(
    ("buttons", "code", "bits"),
    [
        ("", 0, 384),
        ("left_up", 1, 16),
        ("left_down", 2, 32),
        ("right_up", 3, 64),
        ("right_down", 4, 128),
        ("left_up right_up", 5, 80),
        ("left_up right_down", 6, 144),
        ("left_down right_up", 7, 96),
        ("left_down right_down", 8, 160),
        ("beacon", 9, 384),
        ("left_up left_down", 10, 48),
        ("right_up right_down", 11, 192),
        ("left_up left_down right_up", 0, 112),
        ("left_up left_down right_up right_down", 0, 240),
    ],
)
def test_buttons_of_the_infrared_remote(buttons: str, code: int, bits: int) -> None:
    machine = Surroundings()
    machine.down = frozenset(buttons.split())
    assert sent(SensorKind.EV3_INFRARED, "IR-REMOTE", machine) == (code, 0, 0, 0)
    assert sent(SensorKind.EV3_INFRARED, "IR-REM-A", machine) == (bits,)


@pytest.mark.parametrize(
    ("turned", "angle", "rate"),
    [
        ((0.0, 0.0), 0, 0),
        ((30.4, -12.6), 30, -13),
        ((32_767.0, 440.0), 32_767, 440),
        ((32_768.0, 441.0), 32_767, 440),
        ((-40_000.0, -1000.0), -32_767, -440),
        (15.6, 16, 0),
    ],
)
def test_gyroscope_of_an_ev3_ends_at_its_ranges(turned: Any, angle: int, rate: int) -> None:
    assert sent(SensorKind.EV3_GYRO, "GYRO-G&A", rotation=turned) == (angle, rate)
    assert sent(SensorKind.EV3_GYRO, "GYRO-ANG", rotation=turned) == (angle,)
    assert sent(SensorKind.EV3_GYRO, "GYRO-RATE", rotation=turned) == (rate,)


@pytest.mark.parametrize(("distance_mm", "tenths"), [(0, 0), (254, 100), (30, 12), (2550, 1004)])
def test_distance_of_an_ev3_in_tenths_of_inches(distance_mm: int, tenths: int) -> None:
    machine = Surroundings()
    machine.distance = distance_mm
    for mode in ("US-DIST-IN", "US-SI-IN", "US-DC-IN"):
        assert sent(SensorKind.EV3_ULTRASONIC, mode, machine) == (tenths,)
    for mode in ("US-DIST-CM", "US-SI-CM", "US-DC-CM"):
        assert sent(SensorKind.EV3_ULTRASONIC, mode, machine) == (distance_mm,)
