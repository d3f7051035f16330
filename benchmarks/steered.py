"""A trained policy that is steered by three numbers, which can be searched in a world that nobody
knows.

SAC learns in drawn worlds. What it learned stays as it is; how far each step goes, and at which
phases the policy sees the legs, are the few bounded numbers of a structured policy: it then holds
them at other phases, as a gait of oscillators does by the same numbers.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import torch
from tensordict import TensorDict
from torch import Tensor, nn

import bricksrl
from benchmarks.conditioned import search_over
from benchmarks.gait import WALKER
from brickhub.entry import Entry
from bricksrl.agents.learner import Learner
from bricksrl.training import TrainConfig, train
from bricksrl.training.learners import load_learner

NUMBERS = (
    Entry("stride", 0.8, 1.3),
    Entry("left_right_deg", -40.0, 40.0, unit="deg"),
    Entry("front_back_deg", -40.0, 40.0, unit="deg"),
)
"""Share of the policy's own steps, and how much later it sees the right legs, and the back ones."""
_RIGHT, _BACK = (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
"""Of the legs left front, right front, left back, right back, as the Walker observes and moves
them."""


class Steered(nn.Module):
    """Structure: a trained policy whose steps are scaled, and which sees legs at other phases."""

    numbers = NUMBERS

    def __init__(self, policy: Learner) -> None:
        super().__init__()
        self._policy = policy

    def forward(self, observation: Tensor, numbers: Tensor) -> Tensor:
        stride, right_deg, back_deg = numbers.unbind(-1)
        later_deg = right_deg[..., None] * torch.tensor(_RIGHT)
        later_deg = later_deg + back_deg[..., None] * torch.tensor(_BACK)
        legs = len(_RIGHT)
        seen_deg = torch.remainder(observation[..., :legs] - later_deg, 360.0)
        seen = torch.cat((seen_deg, observation[..., legs:]), -1)
        chosen: Tensor = self._policy.exploit(TensorDict({"observation": seen}, seen.shape[:-1]))[
            "action"
        ]
        # An action of 1 leaves a leg where it is, one of -1 turns it as far as a step can.
        return 1 - stride[..., None] * (1 - chosen)


def of_run(run: str) -> Steered:
    """The structure of the policy that was trained in a folder."""
    with closing(bricksrl.make(WALKER, seed=0)) as env:
        return Steered(load_learner(run, env).learner)


def steered(seed: int, episodes: int, folder: Path) -> TrainConfig:
    """Train the policy in drawn worlds; the search over its numbers on the nominal twin, which is
    still to be run."""
    policy = (folder / "policy").absolute()
    train(TrainConfig(WALKER, "sac", episodes, seed, randomize=True, record=False, run_dir=policy))
    return search_over(__name__, policy, seed)
