"""What an agent has seen, and how it holds what it reads within that."""

from __future__ import annotations

import logging
import math
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from small import LAYOUT, settings
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.agents.features.encoder import Encoder
from bricksrl.agents.features.observed import ObservationEncoder, SeenInputs
from bricksrl.envs.specs import ImageShape, ObservationLayout

NAMES = ("angle", "speed", "goal")


def seen(*rows: tuple[float, float, float], names: tuple[str, ...] = NAMES) -> SeenInputs:
    """Of an angle that wraps, a speed, and a goal, which may be anywhere."""
    inputs = SeenInputs(names, (True, False, False), (2,))
    if rows:
        inputs.see(torch.tensor(rows))
    return inputs.eval()


def held(inputs: SeenInputs, *row: float) -> list[float]:
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        return inputs(torch.tensor(row)).tolist()


def test_speed_is_held_within_what_was_seen_and_goals_are_free() -> None:
    inputs = seen((10.0, -2.0, 5.0), (200.0, 3.0, 5.0))
    assert held(inputs, 300.0, 4.0, 90.0) == [300.0, 3.0, 90.0]
    assert held(inputs, 0.0, -9.0, -90.0) == [0.0, -2.0, -90.0]
    assert held(inputs, 50.0, 1.0, 5.0) == [50.0, 1.0, 5.0]


def test_angle_is_held_only_where_it_never_varied() -> None:
    inputs = seen((90.0, 1.0, 0.0), (90.0, 2.0, 0.0))
    assert held(inputs, 270.0, 1.5, 0.0) == [90.0, 1.5, 0.0]


def test_what_was_never_seen_holds_nothing() -> None:
    assert held(seen(), 270.0, 1e6, -1e6) == [270.0, 1e6, -1e6]


def test_only_an_agent_that_acts_at_its_best_is_held() -> None:
    inputs = seen((0.0, -1.0, 0.0), (9.0, 1.0, 0.0))
    row = torch.tensor([0.0, 7.0, 0.0])
    with set_exploration_type(ExplorationType.RANDOM):
        assert torch.equal(inputs(row), row)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert torch.equal(inputs.train()(row), row)
        assert inputs.eval()(row)[1] == 1.0


@given(
    st.lists(
        st.tuples(*[st.floats(-1e3, 1e3)] * 3),
        min_size=2,
        max_size=12,
    ),
    st.integers(1, 11),
)
def test_parts_are_counted_as_the_whole(rows: list[tuple[float, float, float]], cut: int) -> None:
    """Mean and deviation by their definitions; a batch may have any shape."""
    inputs = seen()
    whole = torch.tensor(rows, dtype=torch.float32)
    for part in (whole[:cut], whole[cut:]):
        if len(part):
            inputs.see(part[None])
    count, mean, squares = inputs.moments
    double = whole.double()
    assert count.tolist() == [len(rows)] * 3
    assert mean.tolist() == pytest.approx(double.mean(0).tolist(), abs=1e-6)
    deviations = (double - double.mean(0)).square().sum(0)
    assert squares.tolist() == pytest.approx(deviations.tolist(), rel=1e-6, abs=1e-4)
    assert torch.equal(inputs.least, whole.amin(0))
    assert torch.equal(inputs.greatest, whole.amax(0))


def test_numbers_are_scaled_by_mean_and_deviation() -> None:
    inputs = seen((1.0, 7.0, 0.0), (3.0, 7.0, 0.0), (5.0, 7.0, 0.0))
    scaled = inputs.normalised(torch.tensor([[5.0, 9.0, 1.0], [3.0, 7.0, 0.0]]))
    # Of 1, 3 and 5 the mean is 3, the variance 8/3; what never varied decides nothing.
    assert scaled[0].tolist() == pytest.approx([2.0 / math.sqrt(8.0 / 3.0), 0.0, 0.0])
    assert scaled[1].tolist() == [0.0, 0.0, 0.0]
    assert scaled.dtype is torch.float32
    assert seen().normalised(torch.ones(3)).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("value", "is_far"), [(8.0, False), (8.5, True), (-4.0, False), (-4.5, True), (1.0, False)]
)
def test_reading_far_from_what_was_seen_is_said(
    caplog: pytest.LogCaptureFixture, value: float, is_far: bool
) -> None:
    """From 0 to 4 was seen: far is what is more than 4 outside of it."""
    inputs = seen((0.0, 0.0, 0.0), (1.0, 4.0, 0.0))
    with caplog.at_level(logging.WARNING):
        held(inputs, 0.0, value, 1e9)
        held(inputs, 0.0, value, 1e9)
    message = (
        f"speed reads {value:g}, but the agent learned with 0 to 4: it acts as if it read that"
    )
    assert caplog.messages == ([message] if is_far else []), "once of each"


def test_reading_that_never_varied_is_said_with_its_value(
    caplog: pytest.LogCaptureFixture,
) -> None:
    inputs = seen((90.0, 7.0, 0.0), names=())
    with caplog.at_level(logging.WARNING):
        held(inputs, 91.0, 7.0, 3.0)
    assert caplog.messages == [
        "input 0 reads 91, but the agent learned with 90: it acts as if it read that"
    ]
    inputs.warned.clear()
    inputs.says = False
    with caplog.at_level(logging.WARNING):
        held(inputs, 91.0, 7.0, 3.0)
    assert len(caplog.messages) == 1


LENGTHS = ObservationLayout(
    (0.0, -math.inf),
    (10.0, math.inf),
    (False, False),
    names=("way", "force"),
    scale=(0.5, 4.0),
    offset=(1.0, -2.0),
    frames=(0, 0),
)


def test_what_a_transform_has_scaled_comes_back_to_its_unit() -> None:
    encoder = ObservationEncoder(LENGTHS)
    assert encoder.in_units(torch.tensor([3.5, 10.0])).tolist() == [5.0, 3.0]
    # The way is in the middle of its range, and the force has none.
    assert encoder(torch.tensor([3.5, 10.0])).tolist() == pytest.approx([0.0, 3.0], abs=1e-6)


def test_features_are_normalised_where_that_was_asked_for() -> None:
    encoder = ObservationEncoder(LENGTHS, normalize=True)
    encoder.seen.see(torch.tensor([[2.0, 1.0], [4.0, 5.0]]))
    # In units 5 and 3: the way is 2 above its mean of 3, with a deviation of 1.
    assert encoder(torch.tensor([3.5, 10.0])).tolist() == pytest.approx([2.0, 0.0])


def test_frozen_encoder_sees_nothing_new() -> None:
    encoder = Encoder(LAYOUT, settings("sac"))
    frames = TensorDict({"observation": torch.rand(4, 8)}, [4])
    encoder.see(frames)
    least = encoder.numbers.seen.least.clone()
    encoder.is_frozen = True
    encoder.see(TensorDict({"observation": torch.full((4, 8), -9.0)}, [4]))
    assert torch.equal(encoder.numbers.seen.least, least)
    encoder.is_frozen = False
    encoder.see(TensorDict({"observation": torch.full((4, 8), -9.0)}, [4]))
    assert encoder.numbers.seen.least.tolist() == [-9.0] * 8


def test_vectors_are_joined_in_the_order_of_their_keys() -> None:
    layout = ObservationLayout(
        (-math.inf,) * 5,
        (math.inf,) * 5,
        (False,) * 5,
        vectors=(("near", (2,)), ("far", (1, 3))),
    )
    encoder = Encoder(layout, settings("sac"))
    assert encoder.in_keys == ["near", "far"]
    near = torch.tensor([[1.0, 2.0]])
    far = torch.tensor([[[3.0, 4.0, 5.0]]])
    assert encoder(near, far).tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0]]
    encoder.see(TensorDict({"near": near, "far": far}, [1]))
    assert encoder.numbers.seen.greatest.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize("encoder", ["keypoints", "convolutions"])
def test_images_come_before_numbers(encoder: Any) -> None:
    image = ImageShape("image", 36, 3, is_channels_last=True)
    vectors = (("observation", (2,)),)
    layout = ObservationLayout((0.0,) * 2, (1.0,) * 2, (False,) * 2, images=(image,))
    alone = Encoder(layout, settings("sac", encoder=encoder))
    with_numbers = ObservationLayout((0.0,) * 2, (1.0,) * 2, (False,) * 2, (), (image,), vectors)
    both = Encoder(with_numbers, settings("sac", encoder=encoder))
    picture = torch.zeros(1, 36, 36, 3, dtype=torch.uint8)
    numbers = torch.tensor([[0.5, 1.0]])
    features = both(numbers, picture)
    images_size = {"keypoints": 32, "convolutions": 128}[encoder]
    assert features.shape == (1, both.size)
    assert both.size == images_size + {"keypoints": 2, "convolutions": 32}[encoder]
    assert torch.equal(features[:, :images_size], both(numbers * 0.0, picture)[:, :images_size])
    if encoder == "keypoints":
        assert features[0, images_size:].tolist() == [0.0, 1.0], "scaled from 0..1 to -1..1"
    assert alone(picture).shape == (1, images_size)
