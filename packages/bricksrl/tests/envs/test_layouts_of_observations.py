"""Layouts of observations: which number is which entry, in which units, of which frame."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torchrl.data import Bounded, Composite, Unbounded

from brickhub.entry import Entry
from bricksrl.envs.env import outside_text
from bricksrl.envs.specs import (
    ImageShape,
    NominalBounded,
    Number,
    ObservationLayout,
    SpecsEnv,
    end_specs,
    observed_specs,
    spec_entries,
)
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import BricksError, DescriptionError

ANGLE = Entry("arm_angle", 0.0, 360.0, "deg", wraps=True)
GOAL = Entry("arm_goal", 0.0, 360.0, "deg", wraps=True)
JOINT_GOAL = Entry("low_goal", -90.0, 90.0, "deg")
JOINT = Entry("low_angle", -90.0, 90.0, "deg")
FREE = Entry("embedding")


def layout(*numbers: Number) -> ObservationLayout:
    return ObservationLayout.of_numbers({"observation": numbers}, [(len(numbers),)], ())


def test_goals_are_paired_with_the_angles_of_their_kind_and_frame() -> None:
    def goals(*numbers: Number) -> tuple[tuple[int, int], ...]:
        return layout(*numbers).goals

    assert goals(Number(GOAL), Number(ANGLE), Number(JOINT), Number(JOINT_GOAL)) == ((0, 1), (3, 2))
    assert goals(Number(GOAL), Number(JOINT)) == ()
    assert goals(Number(GOAL, frame=1), Number(ANGLE)) == ()
    straight = replace(ANGLE, wraps=False)
    assert goals(Number(GOAL), Number(straight)) == (), "a difference would mean nothing"
    twice = [Number(ANGLE), Number(GOAL), Number(ANGLE), Number(GOAL)]
    assert goals(*twice) == ((1, 0), (3, 2))


def test_numbers_of_known_entries_keep_their_units_and_others_are_left_to_transforms() -> None:
    wide = Entry("wind", 0.0, 10.0)
    numbers = [Number(wide, 2.0, 1.0), Number(FREE, 3.0, 4.0), Number(ANGLE, 0.5, 0.0)]
    found = layout(*numbers)
    assert (found.scale, found.offset) == ((2.0, 1.0, 0.5), (1.0, 0.0, 0.0))
    assert (found.low, found.high) == ((0.0, -math.inf, 0.0), (10.0, math.inf, 360.0))
    assert found.wraps == (False, False, True) and found.frames == (0, 0, 0)
    assert found.names == ("wind", "embedding", "arm_angle")
    plain = layout(Number(wide), Number(FREE, 3.0, 4.0))
    assert (plain.scale, plain.offset) == ((), ()), "none has a scale that counts"
    half = replace(FREE, low=0.0)
    assert layout(Number(half, 3.0, 4.0), Number(wide, 2.0)).scale == (1.0, 2.0)
    free_goal, free_angle = (replace(one, low=-math.inf) for one in (JOINT_GOAL, JOINT))
    paired = layout(Number(free_goal, 2.0), Number(free_angle, 2.0))
    assert paired.scale == (2.0, 2.0), "a goal and its angle are compared"


def test_places_are_those_of_the_newest_numbers_in_their_own_units() -> None:
    numbers = [
        Number(ANGLE, frame=1),
        Number(ANGLE),
        Number(JOINT, scale=2.0),
        Number(GOAL, offset=1.0),
        Number(JOINT_GOAL),
    ]
    assert layout(*numbers).places == {"arm_angle": 1, "low_goal": 4}
    assert layout(Number(ANGLE), Number(JOINT)).places == {"arm_angle": 0, "low_angle": 1}


def test_past_numbers_are_known_by_the_newest_of_their_entry() -> None:
    numbers = [
        Number(ANGLE, frame=2),
        Number(ANGLE, frame=1),
        Number(JOINT, frame=1),
        Number(ANGLE),
    ]
    assert layout(*numbers).past == {0: 3, 1: 3}
    assert layout(Number(JOINT, frame=2), Number(JOINT, frame=1)).past == {0: 1}
    assert ObservationLayout((0.0,), (1.0,), (False,)).past == {}


def test_keys_of_a_layout_are_those_of_vectors_and_images() -> None:
    image = ImageShape("image", 8, 3, True)
    found = ObservationLayout.of_numbers(
        {"a": [Number(FREE)], "b": [Number(JOINT)]}, [(1,), (1, 1)], (image,)
    )
    assert found.keys == ["a", "b", "image"]
    assert found.vectors == (("a", (1,)), ("b", (1, 1))) and found.images == (image,)


def test_entries_without_names_are_numbered_with_the_ends_of_their_spec() -> None:
    bounded = spec_entries(
        Bounded(torch.tensor([[0.0], [-2.0]]), torch.tensor([[1.0], [3.0e38]])), "x"
    )
    assert [(entry.name, entry.low, entry.high) for entry in bounded] == [
        ("x_0", 0.0, 1.0),
        ("x_1", -2.0, pytest.approx(3.0e38)),
    ]
    named = NominalBounded.of((ANGLE, JOINT))
    assert spec_entries(named, "x") == (ANGLE, JOINT)
    assert [entry.name for entry in spec_entries(named.expand(2, 2), "x")] == [
        "x_0",
        "x_1",
        "x_2",
        "x_3",
    ]


@pytest.mark.parametrize(
    ("shape", "nominal"),
    [
        ((2,), [False, True]),
        ((4,), [False, True, False, True]),
        ((1, 2), [[False, True]]),
        ((2, 1), [[False], [True]]),
        ((3,), [True, True, True]),
        ((3, 2), [[False, True]] * 3),
    ],
)
def test_nominal_numbers_are_known_behind_stacks_and_further_dimensions(
    shape: tuple[int, ...], nominal: Any
) -> None:
    spec = NominalBounded(torch.zeros(shape), torch.ones(shape))
    assert spec.nominal.tolist() == torch.ones(shape, dtype=torch.bool).tolist()
    spec.entries = (Entry("held", 0.0, 1.0), Entry("free", 0.0, 1.0, limits=(-5.0, 5.0)))
    assert spec.nominal.tolist() == nominal


def test_keys_about_an_episode_are_read_by_no_agent() -> None:
    spec = Composite(
        observation=Unbounded(2),
        step_count=Unbounded(1),
        link_lost=Unbounded(1),
        _secret=Unbounded(1),
        empty=Composite(),
        image=Unbounded((4, 4, 3)),
    )
    env: Any = SimpleNamespace(full_observation_spec_unbatched=spec)
    assert list(observed_specs(env)) == ["observation", "image"]
    for wrong, says in ((Unbounded(()), r"shape \[\]"), (Composite(x=Unbounded(1)), "Composite")):
        env.full_observation_spec_unbatched = Composite(wrong=wrong)
        with pytest.raises(DescriptionError, match=f"an agent reads no 'wrong' .{says}.; rename"):
            observed_specs(env)


def test_ends_of_an_episode_are_flags() -> None:
    for batch in ((), (3,)):
        specs = end_specs(batch)
        assert set(specs.keys()) == {"done", "terminated", "truncated"}
        for name in specs.keys():  # noqa: SIM118  a spec is no dict
            assert specs[name].shape == (*batch, 1) and specs[name].dtype == torch.bool


def test_environment_that_is_elsewhere_makes_no_step() -> None:
    env = SpecsEnv({}, SPINNING)
    for act in (env._reset, lambda: env._step({})):
        with pytest.raises(
            BricksError, match="^this environment is elsewhere; act in the one that"
        ):
            act()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (120.5, "distance is 120.5, outside of 0 to 100 mm"),
        (-3.0, "distance is -3, outside of 0 to 100 mm"),
    ],
)
def test_value_outside_of_its_range_is_told_with_its_unit(value: float, text: str) -> None:
    assert outside_text(Entry("distance", 0.0, 100.0, "mm"), value) == text
    plain = outside_text(Entry("distance", 0.0, 50.0, limits=(0.0, 100.0)), value)
    assert plain == text.removesuffix(" mm")
