from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from toys import Cart

from bricksrl.agents.layout import ObservationLayout, layout_of
from bricksrl.agents.networks import Dropout, ObservationEncoder, StackedBatchNorm, StackedCritics, make_actor, make_policy
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


def test_phases_are_differences_between_angles_that_are_no_goals() -> None:
    layout = ObservationLayout((0.0,) * 3, (360.0,) * 3, (True,) * 3, goals=((2, 0),))
    encoder = ObservationEncoder(layout, "phases")
    features = encoder(torch.tensor([10.0, 280.0, 90.0]))
    assert encoder.size == 8
    torch.testing.assert_close(features[3], torch.tensor(1.0), atol=1e-6, rtol=0)  # sine of 10 - 280, the only difference
    torch.testing.assert_close(features[7], torch.tensor(0.0), atol=1e-6, rtol=0)
    assert ObservationEncoder(layout, "sincos").size == 6


@given(st.floats(0, 360), st.floats(0, 360), st.floats(-50, 50), st.floats(-50, 50))
def test_the_way_to_a_goal_is_the_shorter_one(angle: float, goal: float, joint: float, joint_goal: float) -> None:
    pairs = ((2, 0), (3, 1))
    layout = ObservationLayout((0.0, -50.0) * 2, (360.0, 50.0) * 2, (True, False) * 2, pairs)
    encoder = ObservationEncoder(layout, "raw", "difference")
    features = encoder(torch.tensor([[angle, joint, goal, joint_goal]]))
    assert encoder.size == features.shape[-1] == 6
    way = float(features[0, 4]) * 180.0
    assert abs(way) <= 180.001
    assert abs(((angle + way - goal) + 180.0) % 360.0 - 180.0) < 0.01
    assert float(features[0, 5]) * 50.0 == pytest.approx(joint_goal - joint, abs=0.01)


def test_dropout_drops_its_share_and_keeps_the_mean() -> None:
    torch.manual_seed(0)
    x = torch.ones(2, 500, 100, requires_grad=True)
    for rate in (0.01, 0.5):
        dropped = Dropout(rate)(x)
        kept = dropped != 0
        assert float((~kept).float().mean()) == pytest.approx(rate, rel=0.05)
        torch.testing.assert_close(dropped[kept], torch.full_like(dropped[kept], 1 / (1 - rate)))
        (gradient,) = torch.autograd.grad(dropped.sum(), x)
        assert torch.equal(gradient, dropped.detach())


def test_stacked_batch_normalisations_equal_separate_ones() -> None:
    stacked = StackedBatchNorm(2, 5, momentum=0.3)
    separate = [torch.nn.BatchNorm1d(5, eps=1e-3, momentum=0.3) for _ in range(2)]
    for x in torch.randn(3, 2, 7, 5) + 2.0:
        torch.testing.assert_close(stacked(x), torch.stack([norm(one) for norm, one in zip(separate, x, strict=True)]))
    x = torch.randn(2, 4, 5)
    stacked.eval()
    torch.testing.assert_close(stacked(x), torch.stack([norm.eval()(one) for norm, one in zip(separate, x, strict=True)]))


def test_the_first_critic_alone_is_the_first_of_all() -> None:
    critics = StackedCritics(3, 2, (8, 8), layer_norm=True, k=3)
    features, action = torch.randn(5, 3), torch.randn(5, 2)
    torch.testing.assert_close(critics(features, action, first=1), critics(features, action)[:1])


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
