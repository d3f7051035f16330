"""Steps behind transforms: what repeated actions pay, where they stop, and what of recorded steps
comes through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import (
    CatFrames,
    Compose,
    EnvBase,
    RewardScaling,
    StepCounter,
    TransformedEnv,
    VecNormV2,
)
from toys import Cart

import bricksrl
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.task import Kinematics
from bricksrl.envs.transforms import prepare
from bricksrl.envs.transforms.chain import base_of, insert, transforms_of
from bricksrl.envs.transforms.effect import keeps_actions, one_step, steps_of
from bricksrl.envs.transforms.frame_skip import FrameSkip
from bricksrl.envs.transforms.keep_units import KeepUnits
from bricksrl.envs.transforms.own_steps import Tap, own_frames, own_state
from bricksrl.envs.transforms.prepare import _stack_dim, transformed, with_unit_actions
from bricksrl.envs.transforms.recorded import through
from bricksrl.envs.transforms.state import load_transform_state, transform_state, unaffected
from bricksrl.errors import DataError, DescriptionError

QUIET = Kinematics(noise=0.0)


def acted(env: EnvBase, state: TensorDictBase, action: Tensor) -> Any:
    return env.step(state.clone().set("action", action))["next"]


# ---------------------------------------------------------------- repeated actions


def test_repeated_action_pays_for_each_of_its_steps_and_stops_at_the_end() -> None:
    plain, skipping = Cart(max_steps=5), TransformedEnv(Cart(max_steps=5), FrameSkip(3))
    rewards, lasts = [], []
    plain.set_seed(3)
    state = plain.reset()
    for _ in range(5):
        state = acted(plain, state, torch.tensor([0.5]))
        rewards.append(float(state["reward"]))
        lasts.append(state["observation"])
    skipping.set_seed(3)
    first = acted(skipping, skipping.reset(), torch.tensor([0.5]))
    assert float(first["reward"]) == pytest.approx(sum(rewards[:3]))
    assert torch.equal(first["observation"], lasts[2]) and not bool(first["done"])
    second = acted(skipping, first, torch.tensor([0.5]))
    assert float(second["reward"]) == pytest.approx(sum(rewards[3:]))
    assert torch.equal(second["observation"], lasts[4]) and bool(second["done"])


def test_copies_that_have_ended_wait_for_the_others() -> None:
    """With a threshold that some copies of the arm are below after the first of the steps."""
    named = {"batch_size": 60, "kinematics": QUIET, "threshold_deg": 150.0, "seed": 1}
    plain = bricksrl.make("RoboArmSim-v0", **named)
    skipping = bricksrl.make("RoboArmSim-v0", **named, frame_skip=2)
    action = torch.full((60, 4), 0.7)
    start = plain.reset()
    one = acted(plain, start, action)
    two = acted(plain, one, action)
    both = acted(skipping, skipping.reset(), action)
    done = one["done"]
    assert 0 < int(done.sum()) < 60
    reward = one["reward"] + two["reward"] * ~done
    assert torch.allclose(both["reward"], reward)
    observation = torch.where(done, one["observation"], two["observation"])
    assert torch.equal(both["observation"], observation)
    assert torch.equal(both["terminated"], torch.where(done, one["terminated"], two["terminated"]))


def test_steps_behind_transforms_are_counted_with_what_they_pay() -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0)
    assert steps_of(env) == 1 and keeps_actions(env)
    skipping = bricksrl.make("WalkerSim-v0", seed=0, frame_skip=4)
    step = one_step(skipping)
    assert (step.count, step.paid.tolist(), step.keeps_action) == (4, [4.0], True)
    assert steps_of(skipping) == 4
    scaled = TransformedEnv(bricksrl.make("WalkerSim-v0", seed=0), RewardScaling(0.5, 3.0))
    assert one_step(scaled).paid.tolist() == [3.5] and one_step(scaled).count == 1


# ---------------------------------------------------------------- actions and frames


class Wide(Cart):
    """A cart whose actions are between these ends."""

    def __init__(self, low: float, high: float) -> None:
        super().__init__()
        self.action_spec = Bounded(low, high, (1,))


def test_actions_of_another_range_become_those_of_an_agent() -> None:
    unit = Wide(-1.0, 1.0)
    assert with_unit_actions(unit) is unit
    for low, high in ((-50.0, 150.0), (-1.0, 2.0), (0.0, 1.0)):
        env = with_unit_actions(Wide(low, high))
        assert isinstance(env, TransformedEnv)
        assert (env.action_spec.low, env.action_spec.high) == (-1.0, 1.0)
        assert not keeps_actions(env)
        seen = []
        for action in (-1.0, 0.0, 1.0):
            passed = env.transform.inv(TensorDict(action=torch.tensor([action])))["action"]
            seen.append(float(passed))
        assert seen == pytest.approx([low, (low + high) / 2, high])
    behind = TransformedEnv(Wide(0.0, 1.0), StepCounter())
    assert with_unit_actions(behind) is behind and len(transforms_of(behind)) == 2


@pytest.mark.parametrize(
    ("spec", "kind"),
    [
        (Bounded(-1, 1, (1, 2)), "[1, 2], torch.float32"),
        (Bounded(-1, 1, (2,), dtype=torch.float64), "[2], torch.float64"),
        (Bounded(0, 3, (2,), dtype=torch.int64), "[2], torch.int64"),
    ],
)
def test_actions_that_no_agent_gives_are_described(spec: Any, kind: str) -> None:
    env = Cart()
    env.action_spec = spec
    with pytest.raises(DescriptionError) as caught:
        with_unit_actions(env)
    said = str(caught.value)
    assert said.startswith("an agent gives no such action (Bounded")
    assert said.endswith(f" {kind}); let it take float32 [n] with a range")


@pytest.mark.parametrize(
    ("shape", "dim"),
    [((5,), -1), ((2, 3), -1), ((8, 8, 3), -1), ((3, 8, 8), -3), ((1, 8, 8), -3)],
)
def test_images_are_stacked_by_their_channels(shape: tuple[int, ...], dim: int) -> None:
    assert _stack_dim("seen", Bounded(0, 1, shape)) == dim


class Seeing(Cart):
    """A cart with two images, whose channels come first in one and last in the other."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_spec = Composite(
            observation=Unbounded(2), first=Bounded(0, 1, (3, 6, 6)), last=Bounded(0, 1, (6, 6, 1))
        )

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        return super()._reset(tensordict).update(self._images())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        return super()._step(tensordict).update(self._images())

    def _images(self) -> dict[str, Tensor]:
        share = self.step_count / 10
        return {"first": torch.full((3, 6, 6), share), "last": torch.full((6, 6, 1), share)}


def test_stacks_have_the_oldest_frame_first() -> None:
    env = transformed(Seeing(), EnvOptions(frame_stack=3))
    state = env.reset()
    for _ in range(2):
        state = acted(env, state, torch.tensor([0.1]))
    assert state["observation"].shape == (6,)
    assert (state["first"].shape, state["last"].shape) == ((9, 6, 6), (6, 6, 3))
    assert state["first"][:, 0, 0].tolist() == pytest.approx([0.0] * 3 + [0.1] * 3 + [0.2] * 3)
    assert state["last"][0, 0].tolist() == pytest.approx([0.0, 0.1, 0.2])


def test_own_transform_draws_the_same_wherever_it_is_made(tmp_path: Path) -> None:
    file = tmp_path / "drawn.py"
    file.write_text(
        "import torch\nfrom torchrl.envs import ObservationNorm, TransformedEnv\n"
        "def transform(env):\n"
        "    scale = torch.rand(2) + 1.0\n"
        "    norm = ObservationNorm(torch.zeros(2), scale, in_keys=['observation'])\n"
        "    return TransformedEnv(env, norm)\n",
        encoding="utf-8",
    )
    options = EnvOptions(transform=str(file))
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    scales = []
    for _ in range(2):
        env = transformed(Cart(), options)
        scales.append(transforms_of(env)[1].scale)
    assert torch.equal(*scales) and scales[0].std() > 0.0
    assert torch.equal(torch.rand(1), expected), "what others draw is not changed"


# ---------------------------------------------------------------- own steps


def test_environment_is_prepared_once() -> None:
    env = TransformedEnv(Cart(), Compose(VecNormV2(in_keys=["observation"]), StepCounter()))
    for _ in range(2):
        prepare(env)
        kinds = [type(transform) for transform in transforms_of(env)]
        assert kinds == [Tap, VecNormV2, KeepUnits, StepCounter]
    alone = TransformedEnv(Cart(), StepCounter())
    insert(alone, 1, RewardScaling(0.0, 2.0))
    assert [type(one) for one in transforms_of(alone)] == [StepCounter, RewardScaling]
    assert base_of(alone) is alone.base_env
    copies = TransformedEnv(bricksrl.make("WalkerSim-v0", batch_size=2), StepCounter())
    prepare(copies)
    assert not any(isinstance(one, Tap) for one in transforms_of(copies)), "of one robot alone"


def test_own_steps_are_those_of_the_environment_with_who_acted() -> None:
    env = TransformedEnv(Cart(), Compose(FrameSkip(2), RewardScaling(0.0, 10.0)))
    prepare(env)
    state = env.reset()
    assert torch.equal(own_state(env, state)["observation"], state["observation"])
    state["intervention"] = torch.tensor(True)
    frame = env.step(state.set("action", torch.tensor([0.5])))
    first, second = own_frames(env, frame)
    paid = float(first["next", "reward"]) + float(second["next", "reward"])
    assert float(frame["next", "reward"]) == pytest.approx(10.0 * paid)
    assert torch.equal(first["next", "observation"], second["observation"])
    assert torch.equal(second["next", "observation"], frame["next", "observation"])
    for step in (first, second):
        assert bool(step["intervention"]) and step["action"].tolist() == [0.5]
        assert "done" not in step.keys() and "reward" not in step.keys()  # noqa: SIM118
    assert own_frames(env, frame) == [], "they are given once"


# ---------------------------------------------------------------- recorded steps


def recorded(*actions: float) -> TensorDictBase:
    """Frames of an episode of a cart."""
    cart = Cart(max_steps=len(actions))
    cart.set_seed(1)
    state, frames = cart.reset(), []
    for action in actions:
        frame = cart.step(state.set("action", torch.tensor([action])))
        frames.append(frame.clone())
        state = cart.step_mdp(frame)
    return torch.stack(frames)


def test_recorded_steps_come_through_as_they_would_have_been_made() -> None:
    episode = recorded(0.5, 0.5, -0.25, -0.25, 0.75)
    assert through(Cart(), episode) is episode
    skipping = TransformedEnv(Cart(), FrameSkip(2))
    made = through(skipping, torch.cat((episode, recorded(0.1))))
    assert made["action"][:, 0].tolist() == pytest.approx([0.5, -0.25, 0.75, 0.1])
    rewards = episode["next", "reward"][:, 0]
    sums = [float(rewards[:2].sum()), float(rewards[2:4].sum()), float(rewards[4])]
    assert made["next", "reward"][:3, 0].tolist() == pytest.approx(sums)
    assert made["next", "done"][:, 0].tolist() == [False, False, True, True]
    assert torch.equal(made["observation"][1], episode["observation"][2])
    wide = with_unit_actions(Wide(-1.0, 3.0))
    scaled = through(wide, recorded(0.5, 1.0, -1.0))
    # An agent's 0 is the middle of the range.
    assert scaled["action"][:, 0].tolist() == pytest.approx([-0.25, 0.0, -1.0])
    stacked = through(
        TransformedEnv(Cart(), CatFrames(2, -1, in_keys=["observation"])), recorded(0.5, 0.5)
    )
    assert stacked["observation"].shape == (2, 4)


def test_recorded_steps_that_an_agent_would_not_have_made_are_refused() -> None:
    with pytest.raises(DataError) as caught:
        through(TransformedEnv(Cart(), FrameSkip(2)), recorded(0.5, 0.4))
    assert str(caught.value) == (
        "the data has other actions than these transforms would give; record with them, or omit "
        "them"
    )
    almost = through(TransformedEnv(Cart(), FrameSkip(2)), recorded(0.5, 0.50005))
    assert len(almost) == 1, "but for single precision"


def test_statistics_go_on_in_recorded_steps_and_are_kept_apart_where_asked() -> None:
    env = TransformedEnv(Cart(), VecNormV2(in_keys=["observation"]))
    episode = recorded(*[0.5] * 8)
    through(env, episode)
    kept = transform_state(env)
    assert kept
    with unaffected(env):
        torch.rand(3)
        env.rollout(5)
        changed = transform_state(env)
    again = transform_state(env)
    assert again.keys() == kept.keys()

    def flat(state: Any) -> Tensor:
        values = []
        for value in state.values():
            parts = [value] if isinstance(value, Tensor) else list(value.values())
            values += [part.double().flatten() for part in parts]
        return torch.cat(values)

    assert torch.equal(flat(again), flat(kept)) and not torch.equal(flat(changed), flat(kept))
    other = TransformedEnv(Cart(), VecNormV2(in_keys=["observation"]))
    load_transform_state(other, kept, frozen=True)
    before = flat(transform_state(other))
    assert torch.equal(before, flat(kept))
    other.rollout(5)
    assert torch.equal(flat(transform_state(other)), before), "frozen"
