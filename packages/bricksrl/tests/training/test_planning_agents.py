"""Chunk policies are reset at each episode start."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Composite
from toys import Cart

import bricksrl
from bricksrl.agents import preset
from bricksrl.agents.offline.act import ChunkPolicy
from bricksrl.cli import main
from bricksrl.data import Recorder, describe, load
from bricksrl.data.collect import collect, random_policy
from bricksrl.envs.rollout import play_episodes
from bricksrl.errors import RenderingUnavailableError, RunError
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.film import filmed_env
from bricksrl.policies import load_policy
from bricksrl.policies.sharing import export_policy
from bricksrl.training import RunFolder, TrainConfig, train

RHYTHM = (1.0, 1.0, -1.0, -1.0, 1.0)


class Metronome(Cart):
    """Five steps with a fixed sequence of directions; the observation is 1 at the first step and 0
    later."""

    def __init__(self) -> None:
        super().__init__(len(RHYTHM))
        self.observation_spec = Composite(
            observation=Bounded(torch.tensor([0.0]), torch.tensor([1.0]), dtype=torch.float32)
        )

    def _observation(self) -> torch.Tensor:
        return torch.tensor([float(self.step_count == 0)])

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        reward = -(tensordict["action"] - RHYTHM[self.step_count]).abs()
        self.step_count += 1
        ends = torch.tensor([self.step_count == len(RHYTHM)])
        parts = {
            "observation": self._observation(),
            "reward": reward,
            "terminated": ~ends & ends,
            "truncated": ends,
            "done": ends,
        }
        return TensorDict(parts, batch_size=())


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> TrainConfig:
    """A run that has learned the sequence; a chunk is longer than an episode."""
    folder = tmp_path_factory.mktemp("act")
    env = Metronome()
    beats = iter(RHYTHM * 30)
    with Recorder(folder / "data", describe(env)) as recorder:
        collect(
            env,
            lambda state: state.set("action", torch.tensor([next(beats)])),
            recorder,
            30,
            name="rhythm",
        )
    nets: dict[str, Any] = {
        "width": 16,
        "feedforward": 16,
        "heads": 2,
        "batch_size": 16,
        "dropout": 0.0,
        "learning_rate": 3e-3,
    }
    settings = replace(preset("default", "act"), chunk=8, executed=8, **nets)
    made = TrainConfig(
        "Metronome",
        "act",
        3,
        seed=1,
        settings=settings,
        data=str(folder / "data"),
        updates=220,
        run_dir=folder / "run",
    )
    train(made, env=Metronome())
    return made


def test_offline_episodes_reset_chunks(config: TrainConfig) -> None:
    assert config.run_dir is not None
    episodes = RunFolder(config.run_dir).read_episodes()
    assert episodes[-1].return_ > -0.5
    assert set(episodes[-1].measures) == {"loss_act", "loss_reconstruction", "loss_kl"}


def test_evaluation_resets_chunks(config: TrainConfig) -> None:
    assert config.run_dir is not None
    assert min(evaluate(config.run_dir, Metronome(), episodes=3, save=False).returns) > -0.5


def test_collection_resets_chunks(config: TrainConfig, tmp_path: Path) -> None:
    assert config.run_dir is not None
    env = Metronome()
    policy = load_policy(config.run_dir, env)

    def collected(name: str, **more: Any) -> list[float]:
        with Recorder(tmp_path / name, describe(env)) as recorder:
            return [one.return_ for one in collect(env, policy, recorder, 3, name="act", **more)]

    assert min(collected("anew", reset_policy=policy.reset)) > -0.5
    policy.reset()
    assert collected("on")[1] < -2  # or it goes on in the middle of the rhythm


def test_intervention_resets_chunks(config: TrainConfig, tmp_path: Path) -> None:
    """A human acts in the second step; the agent does not continue its chunk."""
    assert config.run_dir is not None
    steps = 0

    def driver(observation: torch.Tensor) -> torch.Tensor | None:
        nonlocal steps
        steps = 1 if observation[0] else steps + 1
        return torch.zeros(1) if steps == 2 else None

    env = Metronome()
    policy = load_policy(config.run_dir, env)
    policy.reset()
    wanted = float(policy.act(torch.zeros(1)))
    with Recorder(tmp_path / "data", describe(env)) as recorder:
        collect(env, policy, recorder, 2, name="act", driver=driver, reset_policy=policy.reset)
    assert load(tmp_path / "data").action[2::5, 0].tolist() == pytest.approx([wanted] * 2, abs=1e-6)
    beside: Any = {"updates": 0, "data": None, "demonstrations": config.data}
    train(
        replace(config, episodes=1, start=str(config.run_dir), run_dir=tmp_path / "run", **beside),
        env=env,
        driver=driver,
    )
    assert load(tmp_path / "run").action[2, 0] == pytest.approx(wanted, abs=0.05)


def test_continued_learning_does_not_collapse(config: TrainConfig, tmp_path: Path) -> None:
    beside: Any = {"updates": 0, "data": None, "demonstrations": config.data}
    start = replace(
        config, start=str(config.run_dir), episodes=4, run_dir=tmp_path / "next", **beside
    )
    result = train(start, env=Metronome())
    assert min(episode.return_ for episode in result.episodes) > -0.6
    with pytest.raises(RunError, match="act needs demonstrations"):
        train(replace(start, demonstrations=None, run_dir=tmp_path / "none"), env=Metronome())


def test_shared_policy_resets_chunks_each_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0)
    with Recorder(tmp_path / "data", describe(env)) as recorder:
        collect(env, random_policy(env, 0), recorder, 2, name="random")
    run = tmp_path / "run"
    train(
        TrainConfig("WalkerSim-v0", "act", 1, data=str(tmp_path / "data"), updates=4, run_dir=run)
    )
    export_policy(run, tmp_path / "policy")  # a policy that was learned from data is one without
    one, other = load_policy(run, env), load_policy(tmp_path / "policy", env)
    observation = env.reset()["observation"]
    for _ in range(3):
        assert torch.equal(one.act(observation), other.act(observation))

    starts: list[ChunkPolicy] = []
    # append is no method
    monkeypatch.setattr(ChunkPolicy, "reset", lambda self: starts.append(self))  # noqa: PLW0108
    arguments = [
        "--policy",
        str(tmp_path / "policy"),
        "--episodes",
        "3",
        "--out",
        str(tmp_path / "recorded"),
    ]
    assert main(["record", "WalkerSim-v0", *arguments]) == 0
    assert len(starts) == 3
    capsys.readouterr()


def test_video_resets_chunks_each_episode(tmp_path: Path) -> None:
    calls = []

    def act(state: TensorDictBase) -> TensorDictBase:
        calls.append("act")
        return state.set("action", torch.zeros(1))

    env = bricksrl.make("RunAway-v0", seed=0)
    try:
        with filmed_env(env, tmp_path / "film.mp4", "run away", size=(64, 48), budget_s=1.0):
            list(play_episodes(env, act, 2, 1000, reset_policy=lambda: calls.append("reset")))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    finally:
        env.close(raise_if_closed=False)
    assert calls == (["reset"] + ["act"] * (len(calls) // 2 - 1)) * 2
