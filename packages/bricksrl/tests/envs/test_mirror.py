"""Mirrors: a mirrored run of the twin is the run's mirror, batches are mirrored by half, and
descriptions are checked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor
from torchrl.data import Unbounded
from torchrl.envs import (
    CatFrames,
    ObservationNorm,
    ObservationTransform,
    RewardScaling,
    Transform,
    TransformedEnv,
)

import bricksrl
from brickhub.hub.interface import (
    Curve,
    Distance,
    DriveSpeed,
    DriveTurnRate,
    Heading,
    Interface,
    MotorAngle,
    RunAngle,
    Wait,
)
from brickhub.robot import Direction
from bricksrl.agents import make_learner, preset
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import Kinematics, mirrors
from bricksrl.envs.transforms import layout_of
from bricksrl.errors import DescriptionError
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.physics import Physics

QUIET = Physics(tilt_noise_deg=0.0, distance_noise_mm=0.0, distance_noise_ratio=0.0)
TASK = get_task("Walker-v1")


def observed(actions: Tensor, env_id: str) -> Tensor:
    """Observations of a run in the twin, without noise."""
    env = bricksrl.make(env_id, seed=3, physics=QUIET)
    state, observations = env.reset(), []
    for action in actions:
        state = env.step_mdp(env.step(state.set("action", action)))
        observations.append(state["observation"])
    return torch.stack(observations)


@pytest.mark.parametrize("env_id", ["Walker-v1", "Walker-v2"])
def test_a_mirrored_run_of_the_twin_is_the_runs_mirror(env_id: str) -> None:
    observation, action = mirrors(get_task(env_id))
    actions = torch.rand(8, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1
    run, twin = observed(actions, env_id), observation(observed(action(actions), env_id))
    legs = torch.remainder(run[:, :4] - twin[:, :4] + 180.0, 360.0) - 180.0
    tilt, others = (run - twin)[:, 4:6], (run - twin)[:, 7:]
    assert legs.abs().max() < 3.0
    assert tilt.abs().max() < 2.0
    assert others.abs().max() < 3.0, "distance forward, heading, last commands"
    plain = observed(action(actions), env_id)  # what is not mirrored back is another run
    assert (torch.remainder(run[:, :4] - plain[:, :4] + 180.0, 360.0) - 180.0).abs().max() > 20.0


def test_the_reward_is_the_same_in_the_mirror() -> None:
    observation, action = mirrors(TASK)
    before, acted, after = torch.rand(9, 8) * 90, torch.rand(9, 4), torch.rand(9, 8) * 90
    given = TASK.reward(before, acted, after)
    assert torch.equal(given, TASK.reward(observation(before), action(acted), observation(after)))
    assert torch.equal(observation(observation(before)), before)


def test_half_of_each_batch_is_mirrored() -> None:
    env = bricksrl.make("Walker-v1", seed=0)
    torch.manual_seed(0)
    on, off = (
        make_learner("sac", env, replace(preset("default", "sac"), mirror=mirror))
        for mirror in (True, False)
    )
    observation = torch.tensor([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    frame = env.fake_tensordict()
    frame["observation"] = frame["next", "observation"] = observation
    frame["action"] = torch.tensor([0.1, 0.2, 0.3, 0.4])
    for learner in (on, off):
        learner.remember(frame[None])
        learner.dataset = learner.memory.empty_like(4)
        learner.dataset.extend(frame[None])
    (batch,), (plain,) = on.batches(1), off.batches(1)
    mirrored = batch["action"][:, 0] == 0.2
    assert 40 < int(mirrored.sum()) < 88
    image = torch.tensor([2.0, 1.0, 4.0, 3.0, 5.0, -6.0, 7.0, 8.0])
    for part in (batch, batch["next"]):
        assert torch.equal(part["observation"], torch.where(mirrored[:, None], image, observation))
    assert torch.equal(
        batch["action"],
        torch.where(mirrored[:, None], torch.tensor([0.2, 0.1, 0.4, 0.3]), frame["action"]),
    )
    assert torch.equal(plain["observation"], observation.expand(128, 8))
    assert on.dataset is not None
    stored = on.memory[:]
    assert torch.equal(stored["action"][0], frame["action"])


def test_a_mirrored_step_of_the_simulation_is_the_steps_mirror() -> None:
    env = bricksrl.make("WalkerSim-v0", batch_size=64, kinematics=Kinematics(noise=0.0), seed=0)
    (observation, action), start = mirrors(env.task), env.rand_action(env.reset())
    step, env._state = (
        env.step(start.clone())["next"],
        observation(start["observation"]).t().clone(),
    )
    mirrored = env.step(start.update({"action": action(start["action"])}))["next"]
    assert torch.equal(observation(step["observation"]), mirrored["observation"])
    assert torch.equal(step["reward"], mirrored["reward"])


@pytest.mark.parametrize(
    "transform",
    [
        CatFrames(3, -1, in_keys=["observation"]),
        ObservationNorm(3.0 * torch.arange(7), 1.0 + torch.arange(7), in_keys=["observation"]),
        RewardScaling(0.0, 0.1),
    ],
)
def test_batches_are_mirrored_behind_transforms(transform: Transform) -> None:
    env = TransformedEnv(bricksrl.make("WalkerSim-v0", seed=0), transform)
    torch.manual_seed(0)
    learner = make_learner("sac", env)
    memory, task = learner.memory, interface_of(env).task
    assert memory is not None
    assert task is not None
    frames = env.rollout(6)
    learner.remember(frames)
    layout, (entries, action) = layout_of(env), mirrors(task)
    scale, offset = torch.tensor(layout.scale or (1.0,)), torch.tensor(layout.offset or (0.0,))
    images = [frames, frames.clone()]
    images[1]["action"] = action(frames["action"])
    for part in (images[1], images[1]["next"]):
        units = ((part["observation"] - offset) / scale).unflatten(-1, (-1, 7))
        part["observation"] = entries(units).flatten(-2) * scale + offset
    (batch,) = learner.batches(1)
    found = [0, 0]
    for row in batch:
        for which, expected in enumerate(images):
            same = (row["action"] - expected["action"]).abs().amax(-1) < 1e-6
            for part, wanted in ((row, expected[same]), (row["next"], expected["next"][same])):
                torch.testing.assert_close(
                    part["observation"].expand_as(wanted["observation"]), wanted["observation"]
                )
            found[which] += int(same.any())
    assert min(found) > 40
    assert sum(found) == len(batch)


def test_what_a_transform_mixes_is_not_mirrored() -> None:
    env = TransformedEnv(bricksrl.make("WalkerSim-v0", seed=0), RandomProjection())
    memory: Any = make_learner("sac", env).memory
    assert memory._augment == []


class RandomProjection(ObservationTransform):  # type: ignore[misc]
    """Numbers that are no entries."""

    def __init__(self) -> None:
        super().__init__(in_keys=["observation"], out_keys=["observation"])
        self.matrix = torch.rand(7, 7)

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return observation @ self.matrix

    def _reset(self, _tensordict: Any, tensordict_reset: Any) -> Any:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Any) -> Any:
        observation_spec["observation"] = Unbounded(7)
        return observation_spec


def test_the_papers_walker_is_as_it_was() -> None:
    assert not get_task("Walker-v0").symmetric
    assert preset("paper", "sac").mirror is False


def test_signs_follow_from_the_description() -> None:
    same_way = tuple(replace(motor, direction=Direction.CLOCKWISE) for motor in WALKER.motors)
    legs = ("left_front", "right_front", "left_back", "right_back")
    task = replace(
        TASK,
        robot=replace(WALKER, motors=same_way),
        interface=Interface(
            tuple(RunAngle(leg, -50, 50, 500) for leg in legs), TASK.interface.channels, Wait(250)
        ),
    )
    observation, action = mirrors(task)
    assert action(torch.tensor([0.1, 0.2, 0.3, 0.4])).tolist() == pytest.approx(
        [-0.2, -0.1, -0.4, -0.3]
    )
    assert observation(torch.tensor([10.0, 20.0, 0.0, 359.0, 1.0, 2.0, 3.0, 4.0])).tolist() == [
        340,
        350,
        1,
        0,
        1,
        -2,
        3,
        4,
    ]
    driving = replace(TWO_WHEELER, mirrored=(("left", "right"),))
    channels = (MotorAngle("left"), MotorAngle("right"), Heading(), Distance("eyes"))
    interface = Interface((DriveSpeed(-100, 100), DriveTurnRate(-60, 60)), channels, Wait(100))
    observation, action = mirrors(replace(TASK, robot=driving, interface=interface))
    assert action.signs == (1, -1)
    assert (observation.places, observation.signs) == ((1, 0, 2, 3, 4), (1, 1, -1, 1, 1))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"robot": replace(WALKER, mirrored=())},
            "its robot walker is not; give the robot mirrored=",
        ),
        (
            {
                "robot": replace(
                    WALKER, mirrored=(("left_front", "left_front"), ("left_back", "right_back"))
                )
            },
            "command 'left_front' has no mirror image in Walker-v1: give it a range about 0",
        ),
        (
            {"robot": replace(TWO_WHEELER, mirrored=(("left", "right"),)), "interface": None},
            "command 'curve' has no mirror image",
        ),
    ],
)
def test_what_has_no_mirror_image_is_refused(changes: dict[str, object], message: str) -> None:
    if "interface" in changes:
        channels = (MotorAngle("left"), MotorAngle("right"))
        changes = {
            **changes,
            "interface": Interface((Curve(-90, 90, radius_mm=100),), channels, Wait(100)),
        }
    with pytest.raises(DescriptionError, match=message):
        replace(TASK, **changes)
