"""Kernel of the policy search, number by number."""

from __future__ import annotations

import math

import pytest

from brickhub.entry import Entry
from brickhub.search.kernel import Scales, nearness, place_of, stretched

PHASE = Entry("phase", 0.0, 360.0, "deg", wraps=True)
SPEED = Entry("speed", 100.0, 300.0)
SCALES = Scales(lengths=(0.5, 2.0), peculiar=0.4, amplitude=3.0, noise=0.1)


@pytest.mark.parametrize(
    ("phase_deg", "speed", "place"),
    [
        # The middle of a range is 0, and an angle's a turn begins opposite of it.
        (180.0, 200.0, (1.0, 0.0, 0.0)),
        (0.0, 100.0, (-1.0, 0.0, -1.0)),
        (270.0, 300.0, (0.0, 1.0, 1.0)),
        (90.0, 250.0, (0.0, -1.0, 0.5)),
    ],
)
def test_place_of_numbers(
    phase_deg: float, speed: float, place: tuple[float, float, float]
) -> None:
    assert place_of((phase_deg, speed), (PHASE, SPEED)) == pytest.approx(place, abs=1e-12)


def test_both_coordinates_of_an_angle_have_one_length() -> None:
    point = (1.0, -3.0, 5.0)
    assert stretched(point, (PHASE, SPEED), SCALES) == (2.0, -6.0, 2.5)


def test_nearness_is_the_exponential_of_half_the_squared_distance() -> None:
    assert nearness((1.0, 2.0), (1.0, 2.0)) == 1.0
    assert nearness((0.0, 0.0), (0.6, 0.8)) == pytest.approx(math.exp(-0.5))
    assert nearness((1.0, -1.0), (3.0, -1.0)) == pytest.approx(math.exp(-2.0))


def test_scales_are_the_exponentials_of_their_logarithms_in_order() -> None:
    logarithms = [math.log(number) for number in (0.5, 2.0, 0.4, 3.0, 0.1)]
    found = Scales.of_logarithms(logarithms)
    assert found.lengths == pytest.approx(SCALES.lengths)
    others = (found.peculiar, found.amplitude, found.noise)
    assert others == pytest.approx((0.4, 3.0, 0.1))


def test_later_world_has_half_an_amplitude_and_what_is_peculiar_on_top() -> None:
    first = SCALES.variance(0)
    assert first == pytest.approx(9.0)
    for world in (1, 2):
        assert SCALES.variance(world) == pytest.approx(9.0 + 9.0 * 0.25 + 9.0 * 0.16)


@pytest.mark.parametrize("distance", [0.0, 0.3, 1.5])
def test_what_is_peculiar_to_a_world_reaches_a_third_as_far(distance: float) -> None:
    """A later world's own part falls over 0.3 of the length of the common one."""
    near = math.exp(-0.5 * distance**2)
    own_near = math.exp(-0.5 * (distance / 0.3) ** 2)
    own_part = 9.0 * 0.16 * own_near
    assert SCALES.covariance(near, False) == pytest.approx(9.0 * near)
    assert SCALES.covariance(near, True) == pytest.approx(9.0 * near + 9.0 * 0.25 + own_part)
    assert SCALES.peculiar_part(near) == pytest.approx(own_part)


@pytest.mark.parametrize("is_same_later_world", [False, True])
def test_slope_is_the_change_of_the_covariance_with_the_squared_distance(
    is_same_later_world: bool,
) -> None:
    half_square = 0.02
    step = 1e-6
    before = SCALES.covariance(math.exp(-half_square + step), is_same_later_world)
    after = SCALES.covariance(math.exp(-half_square - step), is_same_later_world)
    slope = SCALES.slope(math.exp(-half_square), is_same_later_world)
    assert slope == pytest.approx((before - after) / (2 * step), rel=1e-6)


def test_noise_has_a_least_variance_for_trials_that_are_repeated() -> None:
    assert SCALES.noise_variance == pytest.approx(0.01, rel=1e-5)
    silent = Scales(lengths=(1.0,), peculiar=0.0, amplitude=1.0, noise=0.0)
    assert silent.noise_variance == pytest.approx(1e-8)
