"""Learner: what training needs of an algorithm. It acts, remembers, learns, and has a state.

Four ways to learn stand behind it: from a replay buffer
(`bricksrl.agents.replay.replay_learner`), from what the policy does now
(`bricksrl.agents.on_policy`), from a dataset alone (`bricksrl.agents.offline.imitation`), and by
search (`bricksrl.agents.search.gait`). The first three descend a gradient, see
`bricksrl.agents.gradient_descent`.
"""

import copy
from collections import deque
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.agents.features.encoder import Encoder
from bricksrl.errors import BricksError, CheckpointError, RunError, message_of


@dataclass
class Learner:
    """A policy that acts and learns nothing; what learns overrides the methods below `remember`.

    Attributes:
        policy: reads the observation, writes "action" in -1..1; explores under
            ``ExplorationType.RANDOM``; may have ``reset``. Kept as a copy that shares its tensors
            and acts without dropout.
        weights: newest weights of a policy trained elsewhere, for the next action; may be set from
            any thread.
    """

    on_policy: ClassVar[bool] = False
    """Whether it learns from actions of its present policy alone: not from a human's, a dataset's
    or several robots'."""
    uses_dataset: ClassVar[bool] = False
    """Whether it learns from a dataset, see `use_dataset`."""
    needs_dataset: ClassVar[bool] = False
    """Whether it learns from nothing else."""

    policy: TensorDictModuleBase
    weights: deque[dict[str, Tensor]] = field(default_factory=lambda: deque(maxlen=1), init=False)
    _copy: TensorDictModuleBase | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        # Without dropout and by running statistics, while the loss trains the original: a memo of
        # what is not to be copied makes the two share their tensors.
        tensors = [*self.policy.parameters(), *self.policy.buffers()]
        shared = {id(tensor): tensor for tensor in tensors}
        self.policy = copy.deepcopy(self.policy, shared).eval()

    @property
    def device(self) -> torch.device:
        """Device of the networks."""
        tensors = [*self.policy.parameters(), *self.policy.buffers()]
        return tensors[0].device if tensors else torch.device("cpu")

    def act_on(self, device: torch.device | str | None) -> None:
        """Act on an environment's device (``None`` is the CPU), with a copy of the policy if the
        networks are on another."""
        if torch.device(device or "cpu").type != self.device.type:
            self._copy = copy.deepcopy(self.policy).to(device or "cpu")

    @property
    def acting(self) -> TensorDictModuleBase:
        """The acting policy."""
        return self.policy if self._copy is None else self._copy

    def explore(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write an exploratory "action"; the argument's name marks a policy for TorchRL."""
        return self._act(tensordict, ExplorationType.RANDOM)

    def exploit(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the best "action"."""
        return self._act(tensordict, ExplorationType.DETERMINISTIC)

    def _act(
        self,
        tensordict: TensorDictBase,
        exploration: ExplorationType,
    ) -> TensorDictBase:
        # Between two actions, so that no action is of half new weights.
        if self.weights:
            self.acting.load_state_dict(self.weights.pop())
        with torch.no_grad(), set_exploration_type(exploration):
            acted: TensorDictBase = self.acting(tensordict)
        return acted

    def reset_policy(self) -> None:
        """Discard the acting policy's state, if any: the next observation does not follow from its
        last action."""
        if hasattr(self.acting, "reset"):
            self.acting.reset()

    def see(self, frames: TensorDictBase) -> None:
        """Note the range of the observations in frames that are learned on: what is acted on is
        held within it."""
        for module in self.policy.modules():
            if isinstance(module, Encoder):
                module.see(frames)
                module.see(frames["next"])

    def policy_state(self) -> dict[str, Tensor]:
        """Copy of the policy's tensors on the CPU."""
        return {
            name: tensor.detach().to("cpu", copy=True)
            for name, tensor in self.policy.state_dict().items()
        }

    @property
    def frames_per_batch(self) -> int:
        """Steps that are remembered at once; 1 for a robot."""
        return 1

    @property
    def prefill_episodes(self) -> int:
        """Initial episodes of uniform actions."""
        return 0

    @property
    def updates_per_step(self) -> float:
        """Updates of networks per environment step; 0 keeps no robot waiting."""
        return 0.0

    @property
    def updates(self) -> int:
        """Number of changes of the policy so far."""
        return 0

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        """Take frames ``[time]`` or ``[copies, time]`` to learn from; robots may alternate."""

    def use_dataset(self, frames: TensorDictBase) -> None:
        """Learn from recorded frames ``[time]`` of whole episodes. Raises RunError if it cannot."""
        raise RunError("this agent cannot use a dataset; choose another agent, or omit the data")

    def end_episodes(self, robot: int | None = None) -> None:
        """End the current episode of a robot, or of all: the next frame does not follow from the
        last."""

    @property
    def needs_hub(self) -> bool:
        """Whether its policy is of no use but on the robot's hub: an exchange takes too long."""
        return False

    def use_hub_of(self, env: EnvBase) -> str:
        """Let the robot's hub do what it can of the acting. Returns a line that says how the robot
        acts, or "" if the computer acts step by step, as for most agents."""
        return ""

    def begin_elsewhere(self) -> None:
        """Go on with another robot, or in another world."""
        self.end_episodes()

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        """Make the updates due for ``steps`` environment steps. Returns mean metrics."""
        return {}

    def make_updates(self, count: int) -> dict[str, Tensor]:
        """Make ``count`` updates. Returns mean metrics, empty without data."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Everything that learning changes: nested tensors, numbers, strings, lists. What only
        further learning needs, such as a replay buffer, is in "memory", and may be left out."""
        return {"updates": self.updates, "policy": dict(self.policy.state_dict())}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state_dict`, on any device. Raises CheckpointError if the state is of another
        algorithm, network or buffer."""
        try:
            self._load(state)
        except BricksError:
            raise
        # A state of another network may have any value where torch expects one of its own, and
        # torch promises no list of errors.
        except Exception as error:  # noqa: BLE001
            reason = message_of(error, typed=True)
            raise CheckpointError(
                f"the checkpoint does not fit this agent ({reason}); resume with the settings it "
                "had"
            ) from None

    def _load(self, state: dict[str, Any]) -> None:
        """Inverse of `state_dict`. Raises any error for another state."""
        self.policy.load_state_dict(state["policy"])
