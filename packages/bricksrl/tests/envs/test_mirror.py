"""Mirrors: a mirrored run of the twin is the run's mirror, batches are mirrored by half, and descriptions are checked."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

import bricksrl
from brickhub.hub.interface import Curve, Distance, DriveSpeed, DriveTurnRate, Heading, Interface, MotorAngle, RunAngle, Wait
from brickhub.robot import Direction
from bricksrl.agents import make_learner, preset
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import mirrors
from bricksrl.errors import DescriptionError
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.physics import Physics

QUIET = Physics(tilt_noise_deg=0.0, distance_noise_mm=0.0, distance_noise_ratio=0.0)
TASK = get_task("Walker-v1")


def observed(actions: Tensor) -> Tensor:
    """Observations of a run in the twin of Walker-v1, without noise."""
    env = bricksrl.make("Walker-v1", seed=3, physics=QUIET)
    state, observations = env.reset(), []
    for action in actions:
        state = env.step_mdp(env.step(state.set("action", action)))
        observations.append(state["observation"])
    return torch.stack(observations)


def test_a_mirrored_run_of_the_twin_is_the_runs_mirror() -> None:
    observation, action = mirrors(TASK)
    actions = torch.rand(8, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1
    run, twin = observed(actions), observation(observed(action(actions)))
    legs = torch.remainder(run[:, :4] - twin[:, :4] + 180.0, 360.0) - 180.0
    tilt, forward = (run - twin)[:, 4:6], (run - twin)[:, 7]
    assert legs.abs().max() < 3.0
    assert tilt.abs().max() < 2.0
    assert forward.abs().max() < 3.0
    plain = observed(action(actions))  # what is not mirrored back is another run
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
    on, off = (make_learner("sac", env, replace(preset("default", "sac"), mirror=mirror)) for mirror in (True, False))
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
    assert torch.equal(batch["action"], torch.where(mirrored[:, None], torch.tensor([0.2, 0.1, 0.4, 0.3]), frame["action"]))
    assert torch.equal(plain["observation"], observation.expand(128, 8))
    assert on.dataset is not None
    stored = on.memory[:]
    assert torch.equal(stored["action"][0], frame["action"])


def test_the_papers_walker_is_as_it_was() -> None:
    assert not get_task("Walker-v0").symmetric
    assert preset("paper", "sac").mirror is False


def test_signs_follow_from_the_description() -> None:
    same_way = tuple(replace(motor, direction=Direction.CLOCKWISE) for motor in WALKER.motors)
    legs = ("left_front", "right_front", "left_back", "right_back")
    task = replace(
        TASK,
        robot=replace(WALKER, motors=same_way),
        interface=Interface(tuple(RunAngle(leg, -50, 50, 500) for leg in legs), TASK.interface.channels, Wait(250)),
    )
    observation, action = mirrors(task)
    assert action(torch.tensor([0.1, 0.2, 0.3, 0.4])).tolist() == pytest.approx([-0.2, -0.1, -0.4, -0.3])
    assert observation(torch.tensor([10.0, 20.0, 0.0, 359.0, 1.0, 2.0, 3.0, 4.0])).tolist() == [340, 350, 1, 0, 1, -2, 3, 4]
    driving = replace(TWO_WHEELER, mirrored=(("left", "right"),))
    channels = (MotorAngle("left"), MotorAngle("right"), Heading(), Distance("eyes"))
    interface = Interface((DriveSpeed(-100, 100), DriveTurnRate(-60, 60)), channels, Wait(100))
    observation, action = mirrors(replace(TASK, robot=driving, interface=interface))
    assert action.signs == (1, -1)
    assert (observation.places, observation.signs) == ((1, 0, 2, 3, 4), (1, 1, -1, 1, 1))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": replace(WALKER, mirrored=())}, "its robot walker is not; give the robot mirrored="),
        (
            {"robot": replace(WALKER, mirrored=(("left_front", "left_front"), ("left_back", "right_back")))},
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
        changes = {**changes, "interface": Interface((Curve(-90, 90, radius_mm=100),), channels, Wait(100))}
    with pytest.raises(DescriptionError, match=message):
        replace(TASK, **changes)
