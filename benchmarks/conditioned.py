"""A policy conditioned on the physics, whose numbers of the physics can be searched (Yu et al.,
2019, arXiv:1903.01390).

SAC learns in drawn worlds and observes the drawn numbers beside its sensors. In a world that nobody
knows they are the few bounded numbers of a structured policy: those that walk best are searched,
whether they are the true ones or not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase, Transform, TransformedEnv

import bricksrl
from benchmarks.gait import STEPS, WALKER
from brickhub.entry import Entry
from bricksrl.agents import preset
from bricksrl.agents.learner import Learner
from bricksrl.agents.replay.augmentation import MirrorRows
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.registry import get_task
from bricksrl.envs.specs import ObservationLayout
from bricksrl.envs.task import Mirror, Task, mirrors
from bricksrl.envs.transforms import layout_of
from bricksrl.training import Callback, TrainConfig, train
from bricksrl.training.learners import load_learner
from bricktwin.twin.physics import PARAMETERS, Physics

_MOTORS = tuple(f"motor_{number}_scale" for number in range(1, 5))
_NAMES = (
    "battery_v",
    "friction_scale",
    "mass_scale",
    "motor_friction_scale",
    "slope_deg",
    "link_interval_ms",
    *_MOTORS,
)
_LOAD = PARAMETERS["side_load_g"]
ENTRIES = (
    *(Entry(name, *PARAMETERS[name].random_range, unit=PARAMETERS[name].unit) for name in _NAMES),
    # a mirrored step has it on the right
    Entry("side_load_g", -_LOAD.random_range[1], _LOAD.random_range[1], unit=_LOAD.unit),
)
"""The numbers of the physics that the policy knows, those that change how the Walker walks, in the
ranges that are drawn."""


def shares(numbers: Tensor) -> Tensor:
    """Numbers ``[*batch, p]`` in -1..1."""
    low, high = (torch.tensor([getattr(one, end) for one in ENTRIES]) for end in ("low", "high"))
    return 2 * (numbers - low) / (high - low) - 1


class KnownPhysics(Transform):  # type: ignore[misc]
    """Appends the numbers of a virtual robot's present physics to its observation."""

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        # none where the layout of the observation is found by trying
        twin: Any = interface_of(self.parent).twin
        physics = Physics() if twin is None else twin.body.physics
        numbers = torch.tensor([getattr(physics, entry.name) for entry in ENTRIES])
        return next_tensordict.set(
            "observation", torch.cat((next_tensordict["observation"], shares(numbers)))
        )

    def _reset(
        self, _tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        spec = observation_spec.clone()
        spec["observation"] = Unbounded((spec["observation"].shape[-1] + len(ENTRIES),))
        return spec


def known(seed: int, **options: Any) -> EnvBase:
    """The Walker, whose physics is observed."""
    return TransformedEnv(bricksrl.make(WALKER, seed=seed, **options), KnownPhysics())


def mirror_of(task: Task, layout: ObservationLayout) -> MirrorRows:
    """The mirror of the task's steps, with the numbers: the load changes sides, motors take each
    other's strength."""
    observed, acted = mirrors(task)
    robot, n = task.robot, len(observed.places)
    motors = [motor.name for motor in robot.motors]
    names, motors = [entry.name for entry in ENTRIES], [motor.name for motor in robot.motors]
    places = {
        name: _MOTORS[motors.index(robot.in_mirror(motor)[0])]
        for name, motor in zip(_MOTORS, motors, strict=True)
    }
    images = (n + names.index(places.get(name, name)) for name in names)
    signs = (-1 if name == "side_load_g" else 1 for name in names)
    whole = Mirror(
        (*observed.places, *images),
        (*observed.signs, *signs),
        (*observed.wraps, *(False for _ in names)),
    )
    return MirrorRows(layout, whole, acted)


class Mirrored(Callback):
    """Callback that mirrors half of each batch, as SAC does by itself where it observes a symmetric
    robot alone."""

    def __init__(self, layout: ObservationLayout) -> None:
        self.layout = layout

    def on_learner(self, learner: Any) -> None:
        learner.memory.append_transform(mirror_of(get_task(WALKER), self.layout))


class Conditioned(nn.Module):
    """Structure: a trained policy that is told the numbers."""

    # the drawn loads: inputs are held within what was seen
    numbers = (*ENTRIES[:-1], replace(ENTRIES[-1], low=0.0))

    def __init__(self, policy: Learner) -> None:
        super().__init__()
        self._policy = policy

    def forward(self, observation: Tensor, numbers: Tensor) -> Tensor:
        told = torch.cat((observation, shares(numbers)), -1)
        action: Tensor = self._policy.exploit(TensorDict({"observation": told}, told.shape[:-1]))[
            "action"
        ]
        return action


def of_run(run: str) -> Conditioned:
    """The structure of the policy that was trained in a folder."""
    return Conditioned(load_learner(run, known(0)).learner)


def conditioned(seed: int, episodes: int, folder: Path) -> TrainConfig:
    """Train the policy in drawn worlds; the search over its numbers on the nominal twin, which is
    still to be run."""
    policy = (folder / "policy").absolute()
    config = TrainConfig(
        WALKER, "sac", episodes, seed, randomize=True, record=False, run_dir=policy
    )
    env = known(seed, randomize=True)
    train(config, Mirrored(layout_of(env)), env=env)
    return search_over(__name__, policy, seed)


def search_over(module: str, policy: Path, seed: int) -> TrainConfig:
    """The search, which is still to be run, over the numbers of the structure that ``of_run`` of a
    module makes of a policy's run."""
    structure = policy.with_name("structure.py")
    called = f"of_run({str(policy)!r})"
    structure.write_text(
        f"from {module} import of_run\n\n\ndef make(env):\n    return {called}\n", "utf-8"
    )
    settings = replace(preset("default", "gait"), structure=f"{structure}:make")
    return TrainConfig(WALKER, "gait", STEPS // 100, seed, settings=settings, record=False)
