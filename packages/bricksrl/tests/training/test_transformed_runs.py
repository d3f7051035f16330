"""Runs behind transforms: recorded, resumed, evaluated, exported, loaded, learned from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from torchrl.data import Bounded, Composite
from torchrl.envs import CatFrames, Compose, RewardSum, SerialEnv, StepCounter, TransformedEnv
from toys import Cart

import bricksrl
from brickhub.seed import episode_seed, evaluation_seed
from bricksrl.agents import preset
from bricksrl.data import load
from bricksrl.envs.rollout import seed_episode
from bricksrl.errors import DataError, DescriptionError, RunError
from bricksrl.evaluation.evaluator import evaluate
from bricksrl.policies.export import export_model
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.run_folder import RunFolder

SMALL = replace(preset("default", "sac"), hidden=(8,), batch_size=16, updates_per_step=0.2)
TRANSFORM = """
from torchrl.envs import Compose, ObservationNorm, RenameTransform, RewardScaling, TransformedEnv, VecNormV2

def drawn(env):
    statistics = ObservationNorm(in_keys=["observation"], standard_normal=True)
    env = TransformedEnv(env, statistics)
    statistics.init_stats(20)
    return env

def transform(env):
    named = RenameTransform(["observation"], ["seen"])
    return TransformedEnv(env, Compose(VecNormV2(in_keys=["observation"]), RewardScaling(0.0, 0.1), named))
"""  # noqa: E501


STEPS = 16
SHORT = {"env": "WalkerSim-v0", "options": {"max_steps": STEPS}}


def config(run_dir: Path, **named: Any) -> TrainConfig:
    task = {} if "env" in named else SHORT
    return TrainConfig(**{**task, "episodes": 2, "settings": SMALL, "run_dir": run_dir, **named})


@pytest.fixture(params=["stacked", "own", "drawn", "normalized"])
def options(request: pytest.FixtureRequest, tmp_path: Path) -> dict[str, Any]:
    file = tmp_path / "mine.py"
    file.write_text(TRANSFORM)
    return {
        "stacked": {"frame_stack": 3, "frame_skip": 2},
        "own": {"transform": str(file)},
        "drawn": {"transform": f"{file}:drawn"},
        "normalized": {"normalize": True},
    }[request.param]


def test_runs_carry_their_transforms(tmp_path: Path, options: dict[str, Any]) -> None:
    whole = train(config(tmp_path / "whole", episodes=3, **options))
    train(config(tmp_path / "part", **options))
    resumed = resume(tmp_path / "part", episodes=3)
    assert [episode.return_ for episode in resumed.episodes] == [
        episode.return_ for episode in whole.episodes
    ]
    assert [episode.length for episode in whole.episodes] == [STEPS] * 3  # steps of the robot
    data = load(tmp_path / "whole")
    assert data.observation.shape == (3 * STEPS, 7)  # its own observations and rewards
    returns = torch.stack([data.reward[data.episode == number].sum() for number in range(3)])
    torch.testing.assert_close(
        returns, torch.tensor([episode.return_ for episode in whole.episodes]), atol=1e-2, rtol=0
    )
    judged = evaluate(tmp_path / "whole", episodes=2, save=False)
    assert judged.as_trained
    assert judged.return_mean < -1.0  # of the robot, not of a scaled reward
    policy = bricksrl.load_policy(tmp_path / "whole")
    env = bricksrl.make("WalkerSim-v0", seed=5)
    actions = env.rollout(10, policy)["action"]  # of the environment itself
    assert actions.shape == (10, 4)
    assert (
        torch.equal(actions[0], actions[1])
        == torch.equal(actions[2], actions[3])
        == ("frame_skip" in options)
    )
    assert not torch.equal(actions[1], actions[2])
    assert export_model(tmp_path / "whole", tmp_path / "policy.pt2") < 1e-4


def test_data_goes_through_the_transforms(tmp_path: Path, options: dict[str, Any]) -> None:
    train(config(tmp_path / "data", **options))
    run = train(config(tmp_path / "run", data=str(tmp_path / "data"), updates=4, **options))
    assert len(run.episodes) == 2


def test_an_environment_with_transforms_is_trained_and_evaluated(tmp_path: Path) -> None:
    def made() -> TransformedEnv:
        return TransformedEnv(
            bricksrl.make("WalkerSim-v0", seed=0, max_steps=40),
            CatFrames(2, -1, in_keys=["observation"]),
        )

    train(config(tmp_path / "run"), env=made())
    assert evaluate(tmp_path / "run", made(), episodes=1, save=False).episodes == 1
    assert bricksrl.load_policy(tmp_path / "run", made()).shapes == {"observation": (14,)}


class WideCart(Cart):
    """A cart whose actions are millimetres."""

    def __init__(self) -> None:
        super().__init__()
        self.action_spec = Bounded(-50.0, 150.0, (1,))
        self.most_mm = 0.0

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.most_mm = max(self.most_mm, float(tensordict["action"]))
        return super()._step(tensordict.set("action", tensordict["action"] / 100.0))


def test_actions_of_another_range_are_scaled(tmp_path: Path) -> None:
    env, data, named = WideCart(), tmp_path / "data", {"env": "Wide", "agent": "td3"}
    settings = replace(preset("default", "td3"), hidden=(16, 16), updates_per_step=0.5)
    train(config(data, episodes=5, settings=settings, **named), env=env)
    assert 100.0 < env.most_mm <= 150.0
    assert load(data).action.max() == pytest.approx(env.most_mm)
    run = train(
        config(tmp_path / "run", settings=settings, data=str(data), updates=4, **named),
        env=WideCart(),
    )
    assert len(run.episodes) == 2
    judged = evaluate(data, WideCart(), episodes=1, seed=3, save=False)
    env = WideCart()
    seed_episode(
        env, episode_seed("evaluation", evaluation_seed(RunFolder(data).read_config().seed, 3), 1)
    )
    frames = env.rollout(8, bricksrl.load_policy(data, env))
    assert float(frames["next", "reward"].sum()) == pytest.approx(judged.return_mean, abs=1e-4)


class Elsewhere(Cart):
    """A cart that observes under another name."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_spec = Composite(state=self.observation_spec["observation"])

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        return super()._reset(tensordict).rename_key_("observation", "state")

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        return super()._step(tensordict).rename_key_("observation", "state")


def test_what_no_dataset_holds_is_not_recorded(tmp_path: Path) -> None:
    train(config(tmp_path / "run", env="Elsewhere"), env=Elsewhere())
    assert not (tmp_path / "run" / "data").exists()
    train(config(tmp_path / "data", env="Cart"), env=Cart())
    with pytest.raises(DataError, match="no data hold what Elsewhere observes"):
        train(
            config(tmp_path / "offline", env="Elsewhere", data=str(tmp_path / "data"), updates=4),
            env=Elsewhere(),
        )


def test_copies_of_an_own_environment(tmp_path: Path) -> None:
    def copies() -> TransformedEnv:
        return TransformedEnv(SerialEnv(2, Cart), Compose(RewardSum(), StepCounter()))

    run = train(config(tmp_path / "run", env="Cart"), env=copies())
    assert all(0 < episode.length <= 8 for episode in run.episodes)
    assert evaluate(tmp_path / "run", copies(), episodes=3, save=False).episodes == 3


@pytest.mark.usefixtures("forked_children")
def test_copies_and_other_processes_have_the_transforms(tmp_path: Path) -> None:
    copies = train(config(tmp_path / "copies", num_envs=3, frame_stack=2))
    assert [episode.length for episode in copies.episodes] == [STEPS] * 2
    apart = train(config(tmp_path / "apart", asynchronous=True, frame_stack=2))
    assert RunFolder(apart.run_dir).read_config().frame_stack == 2


def test_a_transform_may_be_named_by_its_class(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from torchrl.envs import StepCounter\n")
    assert "step_count" in bricksrl.make("WalkerSim-v0", transform=f"{file}:StepCounter").reset()


def test_what_cannot_be_honoured_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("def transform(env):\n    return 3\n")
    with pytest.raises(DescriptionError, match="gives a int"):
        bricksrl.make("WalkerSim-v0", transform=str(file))
    file.write_text("def transform(env):\n    return env.nothing\n")
    with pytest.raises(DescriptionError, match="cannot be applied"):
        bricksrl.make("WalkerSim-v0", transform=str(file))
    file.write_text(TRANSFORM)
    with pytest.raises(RunError, match="different statistics"):
        train(config(tmp_path / "run", env="RunAway-v0", robots=2, transform=str(file)))
    with pytest.raises(
        RunError, match="acts on what the robot itself observes; omit the transforms"
    ):
        train(config(tmp_path / "run", base="scripted", frame_stack=2))
