from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from toys import Cart

from bricksrl.agents.layout import ObservationLayout, layout_of
from bricksrl.agents.networks import ObservationEncoder, StackedCritics, make_actor, make_policy
from bricksrl.envs.registry import get_task
from bricksrl.errors import DescriptionError

LAYOUT = ObservationLayout((0.0, -90.0, 0.0, -math.inf), (360.0, 90.0, 2000.0, math.inf), (True, False, False, False))


def test_encoder_scales_bounds_and_splits_angles() -> None:
    encoder = ObservationEncoder(LAYOUT, "sincos")
    features = encoder(torch.tensor([90.0, -90.0, 2000.0, 7.0]))
    assert encoder.size == 5
    torch.testing.assert_close(features, torch.tensor([-1.0, 1.0, 7.0, 1.0, 0.0]), atol=1e-6, rtol=0)


def test_raw_angles_are_scaled_like_any_entry() -> None:
    encoder = ObservationEncoder(LAYOUT, "raw")
    features = encoder(torch.tensor([[90.0, 0.0, 1000.0, 7.0]]))
    assert encoder.size == 4
    torch.testing.assert_close(features, torch.tensor([[-0.5, 0.0, 0.0, 7.0]]))


@given(st.floats(0, 360), st.floats(-0.5, 0.5))
def test_sincos_knows_no_seam(angle_deg: float, step_deg: float) -> None:
    encoder = ObservationEncoder(ObservationLayout((0.0,), (360.0,), (True,)), "sincos")
    there = (angle_deg + step_deg) % 360.0
    assert (encoder(torch.tensor([angle_deg])) - encoder(torch.tensor([there]))).norm() < 0.01


def test_layout_of_a_task_and_of_a_bare_environment() -> None:
    class WithTask:
        task = get_task("Spinning-v0")

    layout = layout_of(WithTask())  # type: ignore[arg-type]
    assert layout.wraps == (True, True, False, False, False, False)
    assert layout.high == (360.0, 360.0, 90.0, 90.0, 100.0, 1.0)
    assert layout_of(Cart()) == ObservationLayout((0.0, -1.0), (1000.0, 1.0), (False, False))
    assert ObservationLayout.from_dict(layout.to_dict()) == layout


def test_layout_with_uneven_parts_is_refused() -> None:
    with pytest.raises(DescriptionError, match="one length"):
        ObservationLayout((0.0,), (1.0, 2.0), (False,))


def test_policy_acts_in_the_environment() -> None:
    policy = make_policy(make_actor(2, 1, (16,), 0.1), 1)
    rollout = Cart().rollout(8, policy)
    assert rollout["action"].abs().max() <= 1.0
    assert rollout["scale"].min() >= 0.1


def test_stacked_critics_equal_separate_ones() -> None:
    critics = StackedCritics(3, 2, (8, 8), layer_norm=True, dropout=0.0)
    features, action = torch.randn(5, 3), torch.randn(5, 2)
    values = critics(features, action)
    assert values.shape == (2, 5)
    for k in range(2):
        x = torch.cat((features, action), -1)
        for layer in critics.layers:
            if hasattr(layer, "weight") and layer.weight.shape[1] > 1:
                x = x @ layer.weight[k] + layer.bias[k]
            elif hasattr(layer, "weight"):
                x = torch.nn.functional.layer_norm(x, (8,), layer.weight[k, 0], layer.bias[k, 0])
            else:
                x = layer(x)
        torch.testing.assert_close(values[k], x.squeeze(-1))
