"""Agents that learn from images."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest
import torch
from learning import assert_go_on_alike, saved, taught, tensors
from oracle import frozen
from tensordict import TensorDict
from torch import Tensor

from bricksrl.agents import Settings, make_agent, preset
from bricksrl.agents.agent import Agent, Transition, look
from bricksrl.agents.image_agent import ImageAgent
from bricksrl.agents.image_networks import Convolutions, Keypoints, shifted
from bricksrl.agents.image_presets import ImageSACSettings
from bricksrl.agents.image_sac import ImageSACAgent
from bricksrl.agents.image_td3 import ImageTD3Agent
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.sac import SACAgent
from bricksrl.agents.td3 import TD3Agent
from bricksrl.envs import get_task
from bricksrl.errors import CheckpointError, DescriptionError, UnknownNameError

TASK = get_task("RoboArm_mixed-v0")
LAYOUT = ObservationLayout(
    tuple(entry.low for entry in TASK.entries), tuple(entry.high for entry in TASK.entries), tuple(e.wraps for e in TASK.entries)
)
LEARNERS = ("sac", "td3")


def small(agent: str, **changes: Any) -> Settings:
    return replace(preset("default", agent, images=True), **{"hidden": (16,), "batch_size": 6, "actor_delay": 1, **changes})


def sight(column: int) -> TensorDict:
    """Grey, with a red spot in that column."""
    image = torch.full((64, 64, 3), 180, dtype=torch.uint8)
    image[28:34, column : column + 6] = torch.tensor([220, 10, 10], dtype=torch.uint8)
    return TensorDict({"observation": torch.tensor([90.0, 40.0, -70.0]), "image": image}, batch_size=())


def transitions(count: int) -> list[Transition]:
    """The spot jumps; to act towards it pays."""
    generator = torch.Generator().manual_seed(7)
    columns = torch.randint(0, 58, (count + 1,), generator=generator).tolist()
    seen = [sight(column) for column in columns]
    made = []
    for k in range(count):
        action = torch.rand(3, generator=generator) * 2 - 1
        reward = float(action[0]) * (columns[k] - 29) / 29
        made.append(Transition(seen[k], action, reward, seen[k + 1], False, k % 5 == 4))
    return made


def fresh(agent: str, settings: Settings | None = None, seed: int = 11) -> ImageAgent:
    torch.manual_seed(seed)
    made = make_agent(agent, LAYOUT, 3, settings or small(agent), TASK)
    assert isinstance(made, ImageAgent)
    return made


def learned(agent: str, settings: Settings | None = None, updates: int = 3) -> ImageAgent:
    return taught(fresh(agent, settings), transitions(20), updates)


CHANGES: dict[str, Any] = {
    "hidden": (12,),
    "learning_rate": 2e-2,
    "adam_beta": 0.7,
    "batch_size": 5,
    "gamma": 0.5,
    "tau": 0.5,
    "updates_per_step": 3,
    "actor_delay": 2,
    "angles": "raw",
    "encoder": "convolutions",
    "shift_px": 4,
    "replay_size": 10,
    "layer_norm": False,
    "initial_alpha": 0.9,
    "min_scale": 2.0,
    "entropy": 0.0,
    "target_noise": 0.0,
    "target_noise_limit": 0.01,
}
ELSEWHERE = ("prefill_episodes", "exploration_noise")


@pytest.mark.parametrize(
    ("agent", "name"),
    [(agent, field.name) for agent in LEARNERS for field in fields(small(agent)) if field.name not in ELSEWHERE],
)
def test_no_setting_is_dead(agent: str, name: str) -> None:
    usual = small(agent)
    assert CHANGES[name] != getattr(usual, name)
    before, after = tensors(learned(agent, usual)), tensors(learned(agent, small(agent, **{name: CHANGES[name]})))
    assert not all(a.shape == b.shape and torch.equal(a, b) for a, b in zip(before, after, strict=False))


@pytest.mark.parametrize("agent", LEARNERS)
def test_prefill_and_exploration_are_what_the_settings_say(agent: str) -> None:
    assert fresh(agent, small(agent, prefill_episodes=7)).prefill_episodes == 7
    changes = {"exploration_noise": 0.0} if agent == "td3" else {"min_scale": 1.0}
    calm, wild = fresh(agent, small(agent, **changes)), fresh(agent, small(agent))
    if agent == "sac":
        calm, wild = wild, calm
    spread = [torch.stack([each.act(sight(3), explore=True) for _ in range(40)]).std(0).mean() for each in (calm, wild)]
    assert spread[0] < spread[1]


@pytest.mark.parametrize(
    "wrong",
    [
        {"encoder": "eyes"},
        {"angles": "round"},
        {"hidden": ()},
        {"gamma": 2.0},
        {"replay_size": 1},
        {"shift_px": -1},
        {"adam_beta": 1.0},
    ],
)
def test_impossible_settings_are_refused_in_one_line(wrong: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError, match=next(iter(wrong))) as caught:
        ImageSACSettings(**wrong)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("agent", LEARNERS)
@pytest.mark.parametrize("replay_size", [1000, 15])
def test_state_survives_a_file_and_learning_goes_on_bit_for_bit(agent: str, replay_size: int) -> None:
    settings = small(agent, replay_size=replay_size, actor_delay=2, shift_px=2)
    one = learned(agent, settings)
    other = fresh(agent, settings, seed=5)
    other.load_state_dict(saved(one))
    assert_go_on_alike(one, other, transitions(8))


@pytest.mark.parametrize("agent", LEARNERS)
def test_an_actor_elsewhere_acts_the_same(agent: str) -> None:
    one, other = learned(agent), fresh(agent, seed=5)
    assert not torch.equal(one.act(sight(9), explore=False), other.act(sight(9), explore=False))
    other.load_policy_state(one.policy_state())
    assert torch.equal(one.act(sight(9), explore=False), other.act(sight(9), explore=False))


def test_state_of_other_networks_is_refused() -> None:
    with pytest.raises(CheckpointError, match="does not fit this agent"):
        fresh("sac", small("sac", encoder="convolutions")).load_state_dict(learned("sac").state_dict())


@pytest.mark.parametrize("agent", LEARNERS)
def test_only_the_critics_teach_the_encoder(agent: str) -> None:
    made = learned(agent)
    assert isinstance(made, ImageSACAgent | ImageTD3Agent)
    batch = made.draw_batch()
    loss = made.actor_loss(batch)
    actor_loss = loss if isinstance(loss, Tensor) else loss[0]
    weights = list(made.encoder.parameters())
    assert torch.autograd.grad(actor_loss, weights, allow_unused=True) == (None,) * len(weights)
    assert all(gradient.abs().sum() > 0 for gradient in torch.autograd.grad(made.critic_loss(batch), weights)[:1])
    assert not batch.next_features.requires_grad


@pytest.mark.parametrize("agent", LEARNERS)
def test_losses_are_those_of_the_agent_without_eyes(agent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = learned(agent)
    batch = made.draw_batch()
    size = made.encoder.size
    plain = ObservationLayout((-1.0,) * size, (1.0,) * size, (False,) * size)
    own = {f.name: getattr(made.settings, f.name) for f in fields(preset("default", agent)) if hasattr(made.settings, f.name)}  # type: ignore[attr-defined]
    other = make_agent(agent, plain, 3, replace(preset("default", agent), **own))
    for name in ("actor", "critics", "target_critics", *(["temperature"] if agent == "sac" else ["target_actor"])):
        getattr(other, name).load_state_dict(getattr(made, name).state_dict())
    noise = torch.randn(len(batch.reward), 3)
    monkeypatch.setattr(torch, "randn_like", lambda like: noise)
    seen = Batch(batch.features.detach(), batch.action, batch.reward, batch.next_features, batch.terminated)
    assert isinstance(other, SACAgent | TD3Agent)
    with monkeypatch.context() as patched:
        frozen(patched)
        patched.setattr(torch, "randn", lambda *shape: torch.cat((noise, noise)))
        critic_loss, *of_actor = other.learn(seen, actor=True)
    assert torch.allclose(made.critic_loss(batch), critic_loss, rtol=1e-5)
    if isinstance(made, ImageSACAgent):
        assert all(torch.allclose(a, b, rtol=1e-5) for a, b in zip(made.actor_loss(batch), of_actor[:2], strict=True))
    else:
        assert isinstance(made, ImageTD3Agent)
        assert torch.allclose(made.actor_loss(batch), of_actor[0], rtol=1e-5)


@pytest.mark.parametrize("agent", LEARNERS)
def test_learns_to_act_towards_what_it_sees(agent: str) -> None:
    made = fresh(agent, small(agent, gamma=0.0, hidden=(32, 32), batch_size=32))
    taught(made, transitions(150), updates=150)
    assert made.act(sight(54), explore=False)[0] > 0.5
    assert made.act(sight(4), explore=False)[0] < -0.5


def test_without_experience_there_is_nothing_to_update() -> None:
    assert fresh("sac").update() == {}


def test_agents_without_eyes_say_so_in_one_line() -> None:
    for agent in ("droq", "redq", "crossq"):
        with pytest.raises(UnknownNameError, match=f"{agent} cannot learn from images; choose one of sac, td3"):
            make_agent(agent, LAYOUT, 3, None, TASK)
    with pytest.raises(DescriptionError, match="images=True"):
        make_agent("sac", LAYOUT, 3, preset("default", "sac"), TASK)


def test_an_agent_gets_the_image_where_it_sees() -> None:
    state = TensorDict({**sight(3), "reward": torch.zeros(1)}, batch_size=())
    blind: Agent = make_agent("random", LAYOUT, 3, None, TASK)
    assert torch.equal(look(blind, state), state["observation"])
    assert set(look(fresh("sac"), state).keys()) == {"observation", "image"}  # type: ignore[attr-defined]


def test_the_papers_networks() -> None:
    made = fresh("sac", preset("paper", "sac", images=True))
    shapes = [tuple(weight.shape) for name, weight in made.encoder.named_parameters() if name.endswith("weight")]
    convolutions = [(32, 3, 8, 8), (64, 32, 4, 4), (64, 64, 3, 3)]
    assert shapes == [*convolutions, (256, 1024), (128, 256), (128, 3), (32, 128)]
    assert made.encoder.size == 160
    assert preset("paper", "td3", images=True).encoder == "convolutions"  # type: ignore[union-attr]


def test_a_keypoint_follows_what_it_stands_for() -> None:
    eye = Keypoints(64)
    with torch.no_grad():
        images = torch.stack([sight(column)["image"] for column in (5, 25, 45)])
        moved = eye(images).view(3, -1, 2)
    along_columns = moved[:, :, 1]
    assert ((along_columns[1:] - along_columns[:-1]) > 0.2).all(0).any()
    assert moved.abs().max() <= 1.0


@pytest.mark.parametrize(("eye", "side_px"), [(Keypoints, 12), (Convolutions, 32)])
def test_images_too_small_for_the_networks_are_refused(eye: type, side_px: int) -> None:
    with pytest.raises(DescriptionError, match="too small"):
        eye(side_px)


@pytest.mark.parametrize(("eye", "side_px"), [(Keypoints, 16), (Keypoints, 45), (Convolutions, 36), (Convolutions, 84)])
def test_images_of_any_other_size_are_fine(eye: type, side_px: int) -> None:
    made = eye(side_px)
    assert made(torch.zeros(2, side_px, side_px, 3, dtype=torch.uint8)).shape == (2, made.size)


def test_shifted_images_are_moved_whole_and_their_edges_drawn_out() -> None:
    torch.manual_seed(0)
    image = torch.arange(64 * 64).view(64, 64, 1).expand(64, 64, 3) % 251
    images = image.to(torch.uint8).expand(40, 64, 64, 3)
    moved = shifted(images, 4)
    assert moved.dtype == torch.uint8
    padded = (
        torch.nn.functional.pad(images.permute(0, 3, 1, 2).float(), (4, 4, 4, 4), mode="replicate").permute(0, 2, 3, 1).byte()
    )
    cuts = {(y, x): padded[0, y : y + 64, x : x + 64] for y in range(9) for x in range(9)}
    found = {next(place for place, cut in cuts.items() if torch.equal(cut, one)) for one in moved}
    assert len(found) > 20
    assert shifted(images, 0) is images
