from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import TwinError
from brickhub.hub.link.profiles import PROFILES
from bricktwin.twin.physics import PARAMETERS, Physics, RandomPhysics, read_physics, write_physics


def test_every_field_says_its_unit_range_and_source() -> None:
    assert set(PARAMETERS) == {field.name for field in dataclasses.fields(Physics)}
    for name, parameter in PARAMETERS.items():
        assert parameter.unit
        assert parameter.source
        low, high = parameter.random_range
        assert (
            parameter.allowed_range[0]
            <= low
            <= getattr(Physics(), name)
            <= high
            <= parameter.allowed_range[1]
        )


@pytest.mark.parametrize("name", list(PARAMETERS))
def test_invalid_physics_name_parameter(name: str) -> None:
    low, high = PARAMETERS[name].allowed_range
    for value in (low - 1e-6, high + 1e-6, math.nan, math.inf):
        with pytest.raises(TwinError, match=name):
            dataclasses.replace(Physics(), **{name: value})
    for value in (low, high):
        assert getattr(dataclasses.replace(Physics(), **{name: value}), name) == value


@given(seed=st.integers(0, 2**32 - 1), width=st.floats(0.0, 1.0))
def test_draws_stay_within_their_ranges(seed: int, width: float) -> None:
    physics = RandomPhysics(width).sample(np.random.default_rng(seed))
    for name, parameter in PARAMETERS.items():
        default, value = getattr(Physics(), name), getattr(physics, name)
        low, high = (default + width * (bound - default) for bound in parameter.random_range)
        assert low - 1e-9 <= value <= high + 1e-9


def test_draws_cover_ranges() -> None:
    rng = np.random.default_rng(0)
    draws = [RandomPhysics().sample(rng) for _ in range(400)]
    for name, parameter in PARAMETERS.items():
        low, high = parameter.random_range
        share = (
            np.ptp([getattr(physics, name) for physics in draws]) / (high - low)
            if high > low
            else 1.0
        )
        assert share > 0.95, name


def test_draws_are_reproducible_zero_width_is_default() -> None:
    assert RandomPhysics().sample(np.random.default_rng(3)) == RandomPhysics().sample(
        np.random.default_rng(3)
    )
    assert RandomPhysics(0.0).sample(np.random.default_rng(3)) == Physics()


@pytest.mark.parametrize("width", [-0.1, 1.1, math.nan])
def test_width_outside_0_to_1_raises(width: float) -> None:
    with pytest.raises(TwinError, match="width"):
        RandomPhysics(width)


def test_physics_is_written_into_a_new_folder(tmp_path):
    write_physics(tmp_path / "new" / "robot.json", Physics(battery_v=7.4))
    assert read_physics(tmp_path / "new" / "robot.json") == Physics(battery_v=7.4)


def drawn(name: str) -> tuple[float, float]:
    return PARAMETERS[name].random_range


def allowed(name: str) -> tuple[float, float]:
    return PARAMETERS[name].allowed_range


NOMINAL = Physics()


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        # Two lithium cells of 3.6 V, charged to 8.3 V.
        ("battery_v", 7.2, 8.3),
        # At least the two cells of 50 mohm, and as much again in a fresh robot.
        ("battery_ohm", 2 * 0.05, 0.4),
        # LEGO's data sheets: 15 % for a motor, 20 mm for a distance.
        *((f"motor_{number}_scale", 0.85, 1.15) for number in range(1, 7)),
        ("distance_bias_mm", -20.0, 20.0),
        # What was measured on hubs that are not calibrated.
        *((f"acceleration_bias_{axis}_mm_s2", -184.0, 184.0) for axis in "xyz"),
        # All motors report whole degrees.
        ("encoder_resolution_deg", 1.0, 1.0),
    ],
)
def test_what_is_drawn_is_what_the_source_says(name: str, low: float, high: float) -> None:
    assert drawn(name) == pytest.approx((low, high))


@pytest.mark.parametrize(
    ("name", "measured"),
    [
        # Owners read 363.4 and 362.8 degrees for a turn.
        ("gyro_scale_error_pct", 100 * (363.4 / 360 - 1)),
        ("gyro_scale_error_pct", 100 * (362.8 / 360 - 1)),
        # A hub turned by 0.044 degrees in 7 s.
        ("gyro_drift_deg_min", 0.044 * 60 / 7),
        # Sound comes back within the field of view of the sensor's sheet.
        ("echo_angle_deg", 35.0),
        ("soft_range_mm", 1500.0),
    ],
)
def test_what_was_measured_is_near_an_end_or_the_middle_of_what_is_drawn(
    name: str, measured: float
) -> None:
    low, high = drawn(name)
    assert low < measured < high
    nominal = getattr(NOMINAL, name)
    # Either the nominal robot is so, or one that is hardly ever drawn.
    assert nominal == measured or 0.7 * high < measured


def test_noise_of_the_gyroscope_is_that_of_its_data_sheet() -> None:
    """5 mdps for each root of a hertz, up to half of its rate of 833 Hz."""
    assert NOMINAL.gyro_noise_deg_s == pytest.approx(0.005 * math.sqrt(833 / 2), rel=0.03)
    low, high = drawn("gyro_noise_deg_s")
    assert low < NOMINAL.gyro_noise_deg_s < high <= 2 * NOMINAL.gyro_noise_deg_s


OFFSETS = (
    "distance_bias_mm",
    "gyro_scale_error_pct",
    "gyro_drift_deg_min",
    "acceleration_bias_x_mm_s2",
    "acceleration_bias_y_mm_s2",
    "acceleration_bias_z_mm_s2",
    "slope_deg",
    "wheel_difference_pct",
)


@pytest.mark.parametrize("name", OFFSETS)
def test_offsets_have_either_sign_and_a_mean_of_0(name: str) -> None:
    assert getattr(NOMINAL, name) == 0.0
    for low, high in (drawn(name), allowed(name)):
        assert low == -high < 0.0
    # A robot can be worse than what is drawn, several times.
    assert allowed(name)[1] >= 5 * drawn(name)[1]


FACTORS = ("friction_scale", "mass_scale", "motor_friction_scale", "motor_1_scale", "motor_6_scale")


@pytest.mark.parametrize("name", FACTORS)
def test_a_nominal_robot_is_as_it_is_described(name: str) -> None:
    low, high = drawn(name)
    assert getattr(NOMINAL, name) == 1.0 and low < 1.0 < high
    # Nothing is drawn that is less than half, or more than half as much again.
    assert low > 0.5 and high <= 1.5
    # A robot without mass or whose motors stand still is none.
    if name != "motor_friction_scale":
        assert 0.0 < allowed(name)[0] < low


def test_only_offsets_may_be_negative() -> None:
    for name in PARAMETERS:
        assert (allowed(name)[0] < 0.0) is (name in OFFSETS), name


@pytest.mark.parametrize(
    "name",
    [
        "battery_ohm",
        "motor_friction_scale",
        "backlash_deg",
        "distance_noise_mm",
        "distance_noise_ratio",
        "distance_dropout_share",
        "echo_angle_deg",
        "soft_range_mm",
        "tilt_noise_deg",
        "gyro_noise_deg_s",
        "acceleration_noise_mm_s2",
        "color_noise_pct",
        "link_interval_ms",
        "link_jitter_ms",
        "link_loss",
        "link_lost_notifications",
        "link_wake_ms",
        "side_load_g",
    ],
)
def test_what_disturbs_can_be_left_out(name: str) -> None:
    assert getattr(Physics(**{name: 0.0}), name) == 0.0


@pytest.mark.parametrize(
    ("name", "largest"),
    [
        # All readings fail; an angle to a normal is a right one; no sensor sees farther than 2 m;
        # Bluetooth allows four seconds from packet to packet.
        ("distance_dropout_share", 1.0),
        ("echo_angle_deg", 90.0),
        ("soft_range_mm", 2000.0),
        ("link_interval_ms", 4000.0),
    ],
)
def test_no_parameter_is_more_than_it_can_be(name: str, largest: float) -> None:
    assert allowed(name)[1] == largest


def test_a_battery_is_neither_empty_nor_of_other_cells() -> None:
    """The hub switches off at 6 V; two cells that are charged have 8.4 V."""
    low, high = allowed("battery_v")
    assert low == 6.0 and 8.4 <= high <= 9.0
    # A fresh one has lost little yet.
    assert 7.9 <= NOMINAL.battery_v <= 8.3
    # Of its resistance, half is in the cells.
    assert NOMINAL.battery_ohm == pytest.approx(4 * 0.05)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        # A nominal robot is no better and no worse than most.
        ("backlash_deg", 1.0, 4.0),
        ("distance_noise_mm", 0.5, 2.0),
        ("distance_noise_ratio", 0.002, 0.006),
        ("tilt_noise_deg", 0.1, 0.5),
        ("acceleration_noise_mm_s2", 10.0, 39.0),
        ("color_noise_pct", 0.2, 0.9),
    ],
)
def test_estimates_are_in_the_middle_of_what_is_drawn(name: str, low: float, high: float) -> None:
    assert low <= getattr(NOMINAL, name) <= high
    least, most = drawn(name)
    nominal = getattr(NOMINAL, name)
    # Some robots have half of it or less, some one and a half times as much or more, none four
    # times.
    assert least <= 0.7 * nominal and 1.5 * nominal <= most <= 3.5 * nominal
    assert allowed(name)[1] >= 2.0 * most


def test_a_robot_that_is_loaded_leans_to_one_side_alone() -> None:
    assert NOMINAL.side_load_g == 0.0 and NOMINAL.distance_dropout_share == 0.0
    assert drawn("side_load_g") == (0.0, 50.0) and allowed("side_load_g") == (0.0, 500.0)
    # Up to three of a hundred readings fail.
    assert drawn("distance_dropout_share") == (0.0, 0.03)


def test_scales_of_the_motors_are_those_of_their_numbers() -> None:
    scales = {f"motor_{number}_scale": 0.9 + 0.01 * number for number in range(1, 7)}
    assert Physics(**scales).motor_scales == pytest.approx((0.91, 0.92, 0.93, 0.94, 0.95, 0.96))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ([1.0], 'this is not a table of names and numbers; give one such as {"battery_v": 7.4}'),
        ({"battery": 7.4}, "there is no parameter 'battery'; choose from battery_v, battery_ohm, "),
        ({"battery_v": True}, "battery_v is True; give a number"),
        ({"battery_v": "7.4"}, "battery_v is '7.4'; give a number"),
        ({"battery_v": 20}, "battery_v is 20 V; give a value from 6.0 to 9.0"),
        # A factor has no unit.
        ({"mass_scale": 9.5}, "mass_scale is 9.5; give a value from 0.3 to 3.0"),
    ],
)
def test_a_table_of_physics_is_checked(data: object, says: str) -> None:
    with pytest.raises(TwinError) as caught:
        Physics.from_dict(data)
    assert str(caught.value).startswith(f"physics: {says}")


def test_one_link_is_drawn_with_all_its_numbers() -> None:
    class Chosen:
        """Draws the lower end of all ranges but the first, which chooses the link."""

        def __init__(self, share: float) -> None:
            self.share = share
            self.calls = 0

        def uniform(self, low: float, high: float) -> float:
            self.calls += 1
            return low + self.share * (high - low) if self.calls == 1 else low

    links = RandomPhysics().links
    assert len(links) == 2
    for share, number in ((0.0, 0), (0.49, 0), (0.5, 1), (0.99, 1), (1.0, 0)):
        chosen = Chosen(share)
        made = RandomPhysics().sample(chosen)  # type: ignore[arg-type]
        assert made.link == links[number]
        # A number is drawn for each parameter, also where it has no range.
        assert chosen.calls == 1 + len(PARAMETERS)
        assert made.with_link(links[1 - number]).link == links[1 - number]


@pytest.mark.parametrize("name", [name for name in PARAMETERS if name.startswith("link_")])
def test_numbers_of_a_link_are_drawn_between_those_of_ordinary_computers(name: str) -> None:
    numbers = [getattr(PROFILES[link], name.removeprefix("link_")) for link in ("linux", "mac")]
    assert drawn(name) == tuple(sorted(numbers))
