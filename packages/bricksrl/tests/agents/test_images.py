"""Agents with images."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from small import SIGHT, make, same, saved, settings, weights
from tensordict import TensorDict

from bricksrl.agents import make_learner
from bricksrl.agents.actor_critic import ActorCriticLoss
from bricksrl.agents.image_networks import pixels, shift_images
from bricksrl.agents.learner import Learner
from bricksrl.agents.offline.imitation import recorded_memory
from bricksrl.envs.specs import ImageShape

SEEING = ("sac", "droq", "td3", "crossq", "tqc", "iql", "cql", "td3bc")


def frames(count: int, seed: int = 7) -> TensorDict:
    with torch.random.fork_rng():
        SIGHT.set_seed(seed)
        found: TensorDict = SIGHT.rollout(count, break_when_any_done=False)
    return found


def seen(column: int) -> TensorDict:
    return SIGHT.shown(column)


def taught(learner: Learner, updates: int = 2, count: int = 20) -> Learner:
    torch.manual_seed(2)
    learner.remember(frames(count))
    learner.make_updates(updates)
    return learner


@pytest.mark.parametrize("agent", SEEING)
@pytest.mark.parametrize("encoder", ["keypoints", "convolutions"])
def test_learns_and_acts(agent: str, encoder: str) -> None:
    if encoder == "convolutions":
        env: Any = type(SIGHT)(side_px=36)
        learner = make_learner(
            agent, env, settings(agent, images=True, encoder=encoder, batch_size=6)
        )
        torch.manual_seed(1)
        learner.remember(env.rollout(10, break_when_any_done=False))
        state = env.shown(3)
    else:
        learner, state = make(agent, env=SIGHT, batch_size=6), seen(3)
        learner.remember(frames(10))
    before = weights(learner)
    learner.make_updates(1)
    assert not same(before, weights(learner))
    assert "image" in learner.policy.in_keys
    assert learner.explore(state)["action"].shape == (2,)
    assert learner.exploit(torch.stack([state, state]))["action"].shape == (2, 2)


@pytest.mark.parametrize("agent", ["bc", "act", "diffusion"])
def test_imitation_works_with_images(agent: str) -> None:
    learner = make(agent, env=SIGHT)
    assert "image" in learner.policy.in_keys
    learner.dataset = recorded_memory(frames(40), 8, ("observation", "image"), chunk=learner.chunk)
    assert learner.make_updates(2)
    assert learner.exploit(torch.stack([seen(3), seen(9)]))["action"].shape == (2, 2)


def test_ppo_works_with_images() -> None:
    learner = make("ppo", env=SIGHT)
    with torch.no_grad():
        learner.remember(
            SIGHT.rollout(learner.frames_per_batch, learner.policy, break_when_any_done=False)[None]
        )
    assert learner.learn()


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_only_critics_train_encoder(agent: str) -> None:
    learner = taught(make(agent, env=SIGHT))
    loss = learner.loss
    assert isinstance(loss, ActorCriticLoss)
    parameters = list(loss.encoder.parameters())
    found = loss(learner.memory.sample())  # type: ignore[union-attr]
    assert torch.autograd.grad(
        found["loss_actor"], parameters, allow_unused=True, retain_graph=True
    ) == (None,) * len(parameters)
    gradients = torch.autograd.grad(found["loss_qvalue"], parameters)
    assert all(gradient.abs().sum() > 0 for gradient in gradients)


@pytest.mark.parametrize("agent", ["sac", "td3"])
@pytest.mark.parametrize("buffer_size", [1000, 15])
def test_restored_state_continues_bit_identical(agent: str, buffer_size: int) -> None:
    changes = {"buffer_size": buffer_size, "shift_px": 2, "actor_delay": 2}
    one, other = make(agent, env=SIGHT, **changes), make(agent, env=SIGHT, seed=5, **changes)
    for frame in frames(20):
        one.remember(frame[None])
    one.make_updates(3)
    state = saved(one)
    assert state["memory"]["rows"]["image"].shape == (min(buffer_size, 20), 32, 32, 3)
    other.load_state_dict(state)
    for each in (one, other):
        torch.manual_seed(1)
        each.remember(frames(5, seed=8))
        each.make_updates(3)
    assert same(weights(one), weights(other))
    assert torch.equal(one.exploit(seen(9))["action"], other.exploit(seen(9))["action"])


@pytest.mark.parametrize("agent", ["sac", "td3"])
def test_learns_to_act_towards_seen_target(agent: str) -> None:
    learner = make(agent, env=SIGHT, gamma=0.0, hidden=(32, 32), batch_size=32)
    taught(learner, updates=150, count=150)
    assert learner.exploit(seen(25))["action"][0] > 0.4
    assert learner.exploit(seen(1))["action"][0] < -0.4


@pytest.mark.parametrize(
    ("low", "high", "values"),
    [(0.0, 255.0, (0.0, 255.0, 127.5)), (0.0, 1.0, (0.0, 1.0, 0.5)), (-2.0, 2.0, (-2.0, 2.0, 0.0))],
)
def test_pixels_are_from_minus_a_half_to_a_half(
    low: float, high: float, values: tuple[float, float, float]
) -> None:
    shape = ImageShape("image", 2, 3, True, low, high)
    images = torch.tensor(values).view(3, 1, 1, 1).expand(3, 2, 2, 3)
    scaled = pixels(images, shape)
    assert scaled.shape == (3, 3, 2, 2)
    assert scaled[:, 0, 0, 0].tolist() == pytest.approx([-0.5, 0.5, 0.0])


def test_channels_come_first_for_convolutions() -> None:
    image = torch.arange(2 * 2 * 3.0).view(2, 2, 3)
    last = pixels(image.expand(4, 5, 2, 2, 3), ImageShape("image", 2, 3, True, 0.0, 1.0))
    first = pixels(image.permute(2, 0, 1), ImageShape("image", 2, 3, False, 0.0, 1.0))
    assert last.shape == (20, 3, 2, 2) and first.shape == (1, 3, 2, 2)
    assert torch.equal(last[7], first[0])
    assert first[0, 2, 1, 0].item() == pytest.approx(float(image[1, 0, 2]) - 0.5)


def test_images_with_channels_first_are_shifted_alike() -> None:
    images = torch.rand(6, 3, 8, 8)
    torch.manual_seed(0)
    first = shift_images(images, 3, is_channels_last=False)
    torch.manual_seed(0)
    last = shift_images(images.movedim(1, -1), 3)
    assert torch.equal(first, last.movedim(-1, 1)) and not torch.equal(first, images)
