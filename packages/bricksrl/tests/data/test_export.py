from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from toy_data import record

import bricksrl
from bricksrl.data import load
from bricksrl.data.collect import collect, random_policy
from bricksrl.data.formats import export_minari
from bricksrl.data.recorder import Recorder
from bricksrl.data.replay import replay
from bricksrl.data.schema import describe, describe_task
from bricksrl.data.summary import plot, summarise
from bricksrl.envs import get_task
from bricksrl.errors import DataError


@pytest.mark.filterwarnings("ignore")  # of Minari's own
def test_minari_reads_export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import minari

    episodes = load(record(tmp_path / "set", (3, 5)))
    export_minari(tmp_path / "set", tmp_path / "minari/bricksrl/toy-v0")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    dataset = minari.load_dataset("bricksrl/toy-v0")
    assert (dataset.total_episodes, dataset.total_steps) == (2, 8)
    second = dataset[1]
    at = episodes.episode == 1
    assert np.array_equal(second.observations[:-1], episodes.observation[at])
    assert np.array_equal(second.observations[-1], episodes.next_observation[at][-1])
    assert np.array_equal(second.actions, episodes.action[at]) and np.allclose(
        second.rewards, episodes.reward[at]
    )
    assert second.truncations.tolist() == episodes.truncated[at].tolist()
    for name in ("no version", "toy", "toy-v"):
        with pytest.raises(DataError, match="end the path like"):
            export_minari(tmp_path / "set", tmp_path / "other/bricksrl" / name)
    assert not (tmp_path / "other").exists() and not list((tmp_path / "minari").rglob(".part-*"))
    monkeypatch.chdir(tmp_path / "minari/bricksrl")
    export_minari(tmp_path / "set", Path("toy-v1"))
    assert minari.list_local_datasets().keys() == {"bricksrl/toy-v0", "bricksrl/toy-v1"}


@pytest.mark.filterwarnings("ignore")  # of Minari's own
def test_minari_recovers_environment_of_export(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import minari

    env = bricksrl.make("RoboArmSim-v0", sparse=True, seed=0)
    with Recorder(tmp_path / "set", describe(env, {"sparse": True})) as recorder:
        collect(env, random_policy(env, 0), recorder, 1, name="random")
    export_minari(tmp_path / "set", tmp_path / "minari/bricksrl/arm-v0")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    dataset = minari.load_dataset("bricksrl/arm-v0")
    episode, env = dataset[0], dataset.recover_environment()
    observation, _ = env.reset(
        seed=int(next(iter(dataset.storage.get_episode_metadata([0])))["seed"])
    )
    assert np.array_equal(observation, episode.observations[0])
    replayed = [env.step(action)[1] for action in episode.actions]
    assert np.array_equal(replayed, episode.rewards) and set(replayed) <= {0.0, 1.0}, (
        "the reward is sparse"
    )


def test_torchrl_samples_from_dataset(tmp_path: Path) -> None:
    episodes = load(record(tmp_path / "set", (6, 8)))
    torch.manual_seed(0)
    batch = replay(tmp_path / "set", batch_size=64).sample()
    assert batch["observation"].shape == (64, 2) and batch["action"].shape == (64, 1)
    assert (
        batch["next", "reward"].shape
        == batch["next", "done"].shape
        == batch["next", "terminated"].shape
        == (64, 1)
    )
    rows = [int((episodes.observation == row).all(1).nonzero()) for row in batch["observation"]]
    assert torch.equal(batch["episode"], episodes.episode[rows])
    assert len(set(rows)) == 14
    assert torch.equal(batch["next", "observation"], episodes.next_observation[rows])
    assert torch.equal(batch["next", "reward"][:, 0], episodes.reward[rows])
    runs = replay(tmp_path / "set", batch_size=12, slice_len=4).sample()
    starts = runs["observation"].view(3, 4, 2)
    assert torch.equal(starts[:, 1:], runs["next", "observation"].view(3, 4, 2)[:, :-1])


def test_summary_counts(tmp_path: Path) -> None:
    episodes = load(record(tmp_path / "set", (3, 5, 4)))
    summary = summarise(tmp_path / "set")
    assert summarise(str(tmp_path / "set")) == summary
    assert (summary.episodes, summary.transitions, summary.policies) == (3, 12, {"random": 3})
    assert summary.return_mean == pytest.approx(
        np.mean([row.return_ for row in episodes.rows])
    ) and summary.success_rate == pytest.approx(2 / 3)
    assert summary.interventions == int(
        episodes.intervention.sum()
    ) and summary.age_mean_s == pytest.approx(0.02)


def test_picture_is_drawn(tmp_path: Path) -> None:
    plot(record(tmp_path / "set"), tmp_path / "set.png")
    assert (tmp_path / "set.png").read_bytes().startswith(b"\x89PNG")


def test_dataset_description_omits_model() -> None:
    assert "model" not in describe_task(get_task("RunAway-v0"), {}).robot
