"""A small environment: a cart on a line that has to leave a wall."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from bricksrl.envs.connection import Reconnect
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import HubTimeoutError


def assert_equal(a: object, b: object) -> None:
    """Assert equal nested tensors, numbers and texts."""
    assert type(a) is type(b)
    if isinstance(a, dict) and isinstance(b, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_equal(a[key], b[key])
    elif isinstance(a, torch.Tensor) and isinstance(b, torch.Tensor):
        assert torch.equal(a, b)
    else:
        assert a == b


class Cart(EnvBase):
    """Position 0..1000 mm, moved by up to 100 mm per step with noise; reward is the distance in dm;
    ends at 0 mm.

    Like a robot, it has internal state and its own generator.
    """

    def __init__(self, max_steps: int = 8) -> None:
        super().__init__(batch_size=())
        self.observation_spec = Composite(
            observation=Bounded(
                torch.tensor([0.0, -1.0]), torch.tensor([1000.0, 1.0]), dtype=torch.float32
            )
        )
        self.action_spec = Bounded(-1.0, 1.0, shape=(1,))
        self.reward_spec = Unbounded(shape=(1,))
        flag = Binary(1, dtype=torch.bool)
        self.done_spec = Composite(done=flag, terminated=flag.clone(), truncated=flag.clone())
        self.max_steps = max_steps
        self.rng = torch.Generator()
        self.resets = 0
        self.position_mm = torch.zeros(1)
        self.step_count = 0

    def _set_seed(self, seed: int | None) -> None:
        self.rng.manual_seed(seed or 0)

    def _observation(self) -> torch.Tensor:
        return torch.cat((self.position_mm, torch.rand(1, generator=self.rng) * 2 - 1))

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        self.resets += 1
        self.step_count = 0
        self.position_mm = 100.0 + 200.0 * torch.rand(1, generator=self.rng)
        return TensorDict({"observation": self._observation()}, batch_size=())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        before = self.position_mm
        noise = 5.0 * torch.randn(1, generator=self.rng)
        self.position_mm = (before + 100.0 * tensordict["action"] + noise).clamp(0.0, 1000.0)
        self.step_count += 1
        terminated = self.position_mm <= 0.0
        truncated = torch.tensor([self.step_count >= self.max_steps])
        return TensorDict(
            {
                "observation": self._observation(),
                "reward": (self.position_mm - before) / 100.0,
                "terminated": terminated,
                "truncated": truncated,
                "done": terminated | truncated,
            },
            batch_size=(),
        )


class LosingCart(BricksEnv, Cart):
    """A cart with a link that breaks in step ``at`` of episode three; ``failures`` resets fail."""

    def __init__(self, at: int, failures: int = 0) -> None:
        super().__init__()
        self.observation_spec["link_lost"] = Binary(1, dtype=torch.bool)
        self.reconnect: Reconnect = Reconnect()
        self.at, self.failures = at, failures

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        return self.reconnect.until_answered(self._begin)

    def _begin(self) -> TensorDictBase:
        if self.resets == 3 and self.failures:
            self.failures -= 1
            raise HubTimeoutError("the hub is not there; switch it on")
        return super()._reset().set("link_lost", torch.zeros(1, dtype=torch.bool))

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        lost = torch.zeros(1, dtype=torch.bool)
        if not self._is_lost():
            self.reconnect.recovered()
            return super()._step(tensordict).set("link_lost", lost)
        self.link_error = HubTimeoutError("the hub did not answer; switch it on")
        self.reconnect.failed(self.link_error)
        seen = {
            "observation": tensordict["observation"],
            "reward": torch.zeros(1),
            "terminated": lost,
        }
        return TensorDict(
            {**seen, "truncated": ~lost, "done": ~lost, "link_lost": ~lost}, batch_size=()
        )

    def _is_lost(self) -> bool:
        return (self.resets, self.step_count + 1) == (3, self.at)
