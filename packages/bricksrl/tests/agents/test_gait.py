"""Policy search: structures, the Gaussian process, trials, and what a run keeps."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type
from toys import Cart

import bricksrl
from brickhub.hub.interface import Interface, MotorAngle, RunSpeed, Wait
from brickhub.hub.link.robot_link import RobotLink
from brickhub.hub.link.trial_link import TrialLink
from brickhub.robot import HubKind, Motor, Robot
from brickhub.search.oscillators import oscillators
from bricksrl.agents import make_learner, preset
from bricksrl.agents.search.gait import GaitSettings, PolicySearch
from bricksrl.agents.search.structures import Oscillators, make_oscillators
from bricksrl.envs import make
from bricksrl.envs.env_interface import interface_of
from bricksrl.errors import DescriptionError, RunError, UnknownNameError
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.callbacks import Callback
from bricksrl.training.learners import load_learner

SIX = [Motor(name, port) for name, port in zip("abcdef", "ABCDEF", strict=True)]


def searcher(env: str = "WalkerSim-v0", **changes: object) -> PolicySearch:
    torch.manual_seed(0)
    learner = make_learner(
        "gait", make(env, seed=0), dataclasses.replace(preset("default", "gait"), **changes)
    )
    assert isinstance(learner, PolicySearch)
    return learner


def frame(reward: float, pitch: float = 0.0, *, terminated: bool = False) -> TensorDict:
    observation = torch.zeros(1, 7)
    observation[:, 4] = pitch
    after = {
        "observation": observation,
        "reward": torch.tensor([[reward]]),
        "terminated": torch.tensor([[terminated]]),
    }
    return TensorDict(
        {"observation": torch.zeros(1, 7), "action": torch.zeros(1, 4), "next": after}, [1]
    )


def tried(learner: PolicySearch, reward: float, **kinds: object) -> dict[str, Tensor]:
    """A whole trial, or what a tilt leaves of one."""
    before = len(learner.search.trials)
    for _ in range(learner.settings.trial_steps):
        learner.remember(frame(reward, **kinds))
        metrics = learner.learn()
        if len(learner.search.trials) > before:
            return metrics
    raise AssertionError


def hill(numbers: Tensor) -> float:
    """Highest, 1, at a speed of -0.5 and a phase of 350 degrees, which is near 10 too; lowest there
    at 170, nearly -1."""
    near = (numbers[1] - 350.0).deg2rad().cos() - 1.0
    return float(1.0 + near - (numbers[0] + 0.5) ** 2)


def test_a_search_finds_the_top_of_a_landscape_in_thirty_trials_with_noise() -> None:
    learner = searcher()
    noise = torch.Generator().manual_seed(1)
    for _ in range(30):
        tried(learner, hill(learner.actor.trial) + 0.1 * float(torch.randn((), generator=noise)))
    assert hill(learner.actor.best) > 0.85
    assert len(learner.search.trials) == 30


def test_scores_count_once_the_robot_has_settled() -> None:
    learner = searcher(trial_steps=5, settle_steps=2)
    for reward in (-9.0, -9.0, 1.0, 2.0, 4.0):
        learner.remember(frame(reward))
        assert not learner.actor.trial.isnan().any()
    metrics = learner.learn()
    assert learner.search.trials[0].score == 2.25 == float(metrics["trial_reward"]), (
        "what is in the middle counts most"
    )
    assert tuple(metrics) == ("trial_reward", "best_reward", "noise")


@pytest.mark.parametrize("kind", [{"pitch": 36.0}, {"terminated": True}])
def test_a_trial_that_tilts_ends_at_once_and_is_never_good(kind: dict[str, object]) -> None:
    learner = searcher()
    tried(learner, 0.5)
    learner.remember(frame(2.0, **kind))
    assert [trial.score for trial in learner.search.trials] == [0.5, 0.5]
    assert not learner.rewards


def test_a_trial_that_reaches_its_goal_is_as_good_as_its_rewards() -> None:
    learner = searcher("RoboArmSim-v0")
    for observation in (torch.arange(8.0) * 40.0, torch.zeros(8)):  # far from its goal, and there
        after = {
            "observation": observation[None],
            "reward": torch.tensor([[2.0]]),
            "terminated": torch.tensor([[True]]),
        }
        learner.search.trials[:] = learner.search.trials[:1]
        learner.search.tell(-1.0)
        learner.remember(TensorDict({"next": TensorDict(after, [1])}, [1]))
        assert learner.search.trials[-1].score == (2.0 if observation.sum() == 0 else -1.0)


def test_a_trial_that_no_episode_holds_is_refused() -> None:
    with pytest.raises(
        DescriptionError,
        match="no trial of 101 steps ends in an episode of 100 steps; give fewer trial_steps",
    ):
        searcher(trial_steps=101)
    with pytest.raises(DescriptionError, match="in an episode of 50 steps"):
        make_learner(
            "gait", make("WalkerSim-v0", seed=0, frame_skip=2), GaitSettings(trial_steps=51)
        )


def test_legs_are_where_transforms_leave_them() -> None:
    plain, stacked = (
        make_oscillators(make("WalkerSim-v0", seed=0, frame_stack=count)) for count in (1, 3)
    )
    assert plain.angles.tolist() == [0, 1, 2, 3]
    assert stacked.angles.tolist() == [14, 15, 16, 17], "in the newest observation"
    skipping = make_oscillators(make("WalkerSim-v0", seed=0, frame_skip=2))
    assert torch.equal(skipping.gains, plain.gains / 2), "an action turns a leg twice"
    learner = make_learner("gait", make("WalkerSim-v0", seed=0, frame_stack=3))
    assert isinstance(learner, PolicySearch)
    assert learner.tilts == [18, 19]


def test_the_best_known_stays_unless_another_is_better_by_more_than_the_doubt() -> None:
    bold, cautious = searcher(caution=0.0), searcher(caution=20.0)
    for learner in (bold, cautious):
        for reward in (0.5, 0.4, 0.6, 0.7, 0.9):
            tried(learner, reward)
    assert cautious.search.best == cautious.search.trials[0].numbers
    assert bold.search.best != bold.search.trials[0].numbers
    assert torch.equal(bold.actor.best, torch.tensor(bold.search.best))


def test_exploring_tries_and_exploiting_does_the_best() -> None:
    actor = searcher().actor
    actor.trial.copy_(torch.tensor([1.0, 0.0]))
    actor.best.copy_(torch.tensor([-1.0, 0.0]))
    in_phase = torch.tensor([0.0, 180.0, 0.0, 180.0, 0.0, 0.0, 0.0])
    with set_exploration_type(ExplorationType.RANDOM):
        assert actor(in_phase).tolist() == [1.0] * 4
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert actor(in_phase).tolist() == [-1.0] * 4


def test_a_batch_acts_as_one_robot_does() -> None:
    six = oscillators(
        Robot("six", HubKind.PRIME, tuple(SIX), mirrored=(("a", "b"), ("c", "d"))),
        Interface(
            tuple(RunSpeed(motor.name, -400, 200) for motor in SIX),
            tuple(MotorAngle(motor.name) for motor in SIX),
            Wait(100),
        ),
    )
    assert {leg.sign for leg in six.legs} == {1, -1}
    torch.manual_seed(0)
    observation = torch.rand(5, 6) * 360.0
    numbers = torch.rand(5, len(six.numbers)) * 360.0
    numbers[:, 0] = numbers[:, 0] / 180.0 - 1.0
    singly = list(map(six.act, observation.tolist(), numbers.tolist()))
    assert torch.allclose(Oscillators(six)(observation, numbers), torch.tensor(singly), atol=1e-4)


def test_legs_come_to_their_phases_whatever_their_start() -> None:
    structure = make_oscillators(make("WalkerSim-v0", seed=0))
    assert [entry.name for entry in structure.numbers] == ["speed", "left_back_phase"]
    angles, numbers = torch.tensor([10.0, 200.0, 90.0, 300.0]), torch.tensor([-0.2, 140.0])
    for _ in range(30):
        action = structure(torch.cat((angles, torch.zeros(3))), numbers)
        # each leg turns by -100 to 0 degrees
        angles = torch.remainder(angles + 50.0 * (action - 1.0), 360.0)
    apart = torch.remainder(angles - angles[0] + 1e-3, 360.0)
    assert apart.tolist() == pytest.approx([0.0, 180.0, 140.0, 320.0], abs=0.1)


def test_what_has_no_legs_gets_linear_feedback_unless_legs_are_asked_for() -> None:
    learner = searcher("RoboArmSim-v0")
    assert learner.actor.structure.numbers[0].name == "weight_0_0"
    assert learner.exploit(make("RoboArmSim-v0", seed=0).reset())["action"].shape == (4,)
    with pytest.raises(DescriptionError, match="oscillators need motors that turn endlessly"):
        searcher("RoboArmSim-v0", structure="oscillators")


def test_an_unknown_structure_is_no_module() -> None:
    with pytest.raises(
        UnknownNameError,
        match=r"there is no structure 'oscilators' \(did you mean 'oscillators'\?\); choose",
    ):
        searcher(structure="oscilators")


def test_images_are_refused() -> None:
    with pytest.raises(DescriptionError, match="linear feedback reads one vector and no images"):
        searcher("RoboArm_mixed-v0")


def test_a_users_structure_is_searched(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "import torch\nfrom brickhub.entry import Entry\n\n\n"
        "class Same(torch.nn.Module):\n    numbers = (Entry('all', -1.0, 1.0),)\n\n"
        "    def forward(self, observation, numbers):\n"
        "        return numbers.expand(*numbers.shape[:-1], 4)\n\n\n"
        "def same(env):\n    return Same()\n"
    )
    learner = searcher(structure=f"{file}:same")
    action = learner.explore(make("WalkerSim-v0", seed=0).reset())["action"]
    assert action.unique().numel() == 1


def test_a_resumed_search_goes_on_with_the_same_numbers() -> None:
    first = searcher()
    for reward in range(8):
        tried(first, float(reward % 3))
    second = searcher()
    second.load_state_dict(first.state_dict())
    proposals = []
    for learner in (first, second):
        tried(learner, 1.5)
        proposals.append(learner.actor.trial.clone())
    assert torch.equal(*proposals)
    assert first.search.trials == second.search.trials


def test_a_search_goes_on_elsewhere_from_what_it_knows() -> None:
    """The top moves by 20 degrees, and everything is worse."""
    learner = searcher()
    for _ in range(30):
        tried(learner, hill(learner.actor.trial))
    learner.begin_elsewhere()
    assert torch.equal(learner.actor.trial, learner.actor.best)
    before, lowest = hill(learner.actor.best + torch.tensor([0.0, 20.0])), 1.0
    for _ in range(12):
        moved = hill(learner.actor.trial + torch.tensor([0.0, 20.0]))
        lowest = min(lowest, moved)
        tried(learner, moved - 0.2)
    assert hill(learner.actor.best + torch.tensor([0.0, 20.0])) > before
    assert lowest > -0.5  # it does not search everywhere again: the lowest point is at -3.25
    again = searcher()
    again.load_state_dict(learner.state_dict())
    assert again.search.world == 1
    assert [trial.world for trial in again.search.trials] == [0] * 30 + [1] * 12


def test_runs_resume_bit_for_bit_and_show_their_trials(tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    options = {"agent": "gait", "record": False, "options": {"step_ms": 500}}
    train(TrainConfig("WalkerSim-v0", episodes=2, run_dir=whole, **options))
    train(TrainConfig("WalkerSim-v0", episodes=1, run_dir=parts, **options))
    resume(parts, episodes=2)
    rows = [
        list(csv.DictReader((folder / "metrics.csv").read_text().splitlines()))
        for folder in (whole, parts)
    ]
    for row in (*rows[0], *rows[1]):
        row.pop("seconds")
    assert rows[0] == rows[1]
    assert all(
        math.isfinite(float(rows[0][1][name])) for name in ("trial_reward", "best_reward", "noise")
    )


def test_a_run_goes_on_from_another(tmp_path: Path) -> None:
    # an episode of five trials
    steps = {"step_ms": 500}
    options = {"agent": "gait", "episodes": 1, "record": False, "options": steps}
    train(TrainConfig("WalkerSim-v0", run_dir=tmp_path / "here", **options))
    train(
        TrainConfig(
            "WalkerSim-v0", run_dir=tmp_path / "there", seed=1, start=tmp_path / "here", **options
        )
    )
    first, second = (
        load_learner(tmp_path / name, make("WalkerSim-v0", seed=0, **steps)).learner
        for name in ("here", "there")
    )
    assert isinstance(first, PolicySearch)
    assert isinstance(second, PolicySearch)
    trials = second.search.trials
    assert [trial.world for trial in trials] == [0] * 5 + [1] * 5
    assert trials[5].numbers == first.search.best
    assert trials[:5] == first.search.trials


def test_copies_try_the_same_numbers_together(tmp_path: Path) -> None:
    result = train(
        TrainConfig(
            "WalkerSim-v0", "gait", episodes=1, num_envs=3, record=False, run_dir=tmp_path / "run"
        )
    )
    assert "trial_reward" in result.episodes[0].measures


def test_a_fleet_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="learns from what it does now"):
        train(TrainConfig("Walker-v1", "gait", episodes=1, robots=2, run_dir=tmp_path / "run"))


def test_settings_say_what_is_wrong() -> None:
    with pytest.raises(
        DescriptionError, match="settle_steps is 10; give fewer than the 10 of a trial"
    ):
        GaitSettings(settle_steps=10)


def test_the_policy_of_a_run_loads(tmp_path: Path) -> None:
    train(TrainConfig("WalkerSim-v0", "gait", episodes=1, record=False, run_dir=tmp_path / "run"))
    policy = bricksrl.load_policy(tmp_path / "run")
    assert policy.act([0.0] * 7).shape == (4,)


class Links(Callback):
    """The links of a run, and what it says of its trials."""

    def __init__(self) -> None:
        self.links: list[RobotLink] = []
        self.notes: list[str] = []

    def on_env(self, env: EnvBase) -> None:
        interface_of(env).watch(lambda connection: self.links.append(connection.link))

    def on_note(self, note: str) -> None:
        self.notes.append(note)


def test_the_hub_makes_whole_trials_by_itself(tmp_path: Path) -> None:
    seen = Links()
    config = TrainConfig(
        "Walker-v1",
        "gait",
        episodes=1,
        settings=GaitSettings(trial_steps=3, settle_steps=1),
        record=False,
        run_dir=tmp_path / "run",
        options={"step_ms": 2500},
        link="mac",
    )
    assert train(config, seen).episodes[0].length == 10
    assert seen.notes == ["the hub makes each trial by itself, by numbers that are sent once"]
    link = seen.links[-1]
    assert isinstance(link, TrialLink)
    # Three of 3 steps and one of a single step: a trial ends with its episode.
    assert link.writes == 4


@pytest.mark.parametrize(
    ("options", "settings", "reason"),
    [
        ({}, {"on_hub": False}, "on_hub is false"),
        ({"streaming": True}, {}, "it streams"),
        ({"frame_stack": 2}, {"structure": "linear"}, "transforms are between the robot and"),
        ({}, {"structure": "linear"}, "the hub does not know this structure"),
        ({}, {"trial_steps": 50}, "a hub makes 40 of these steps in a trial at most"),
    ],
)
def test_else_each_step_is_an_exchange_and_the_run_says_why(
    options: dict[str, object], settings: dict[str, object], reason: str
) -> None:
    env = make("Walker-v1", seed=0, **options)
    chosen = dataclasses.replace(preset("default", "gait"), **settings)
    note = make_learner("gait", env, chosen).use_hub_of(env)
    assert note.startswith("trials are made step by step from here, as ")
    assert reason in note


def test_a_simulation_has_no_hub_to_speak_of() -> None:
    assert searcher().use_hub_of(make("WalkerSim-v0", seed=0)) == ""


@pytest.mark.parametrize("structure", ["upright", "approach"])
def test_structures_that_act_on_the_hub_need_the_robot_itself(structure: str) -> None:
    """Neither behind transforms, nor without a task of ours."""
    env = make("RunAway-v0", seed=0, frame_skip=2)
    settings = dataclasses.replace(preset("default", "gait"), structure=structure)
    with pytest.raises(DescriptionError):
        make_learner("gait", env, settings)
    with pytest.raises(DescriptionError):
        make_learner("gait", Cart(), settings)
