from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import TwinError
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
