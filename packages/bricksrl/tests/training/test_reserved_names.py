"""Measures that would take the place of something else that is kept of an episode."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import torch

import bricksrl
from bricksrl.envs.registry import get_task
from bricksrl.envs.rollout import play_episodes
from bricksrl.envs.simulation import SimulatedEnv
from bricksrl.envs.task import MEASURED, MEASURED_TOO, Kinematics, Task, check_measures, metrics_of
from bricksrl.errors import DescriptionError
from bricksrl.training import Episode, Phase, RunFolder
from bricksrl.training.loggers import numbers

EPISODE = Episode(1, Phase.TRAIN, 8, 8, 1.5, None, robot="left")


def measuring(*names: object) -> Task:
    metrics = lambda observations: {name: observations[..., 0].mean(-1) for name in names}  # noqa: E731
    return dataclasses.replace(get_task("WalkerSim-v0"), metrics=metrics)


@pytest.mark.parametrize(
    "name",
    [
        *MEASURED,
        *MEASURED_TOO,
        "is_success",
        "final_obs",
        "final_info",
        "_speed",
        "_",
        "",
        " ",
        "a\nb",
        3,
        None,
    ],
)
def test_metric_with_the_name_of_something_else_is_refused(name: object) -> None:
    with pytest.raises(
        DescriptionError, match=r"metrics of WalkerSim-v0 (have the name|are named)"
    ):
        metrics_of(measuring(name), torch.zeros(4, 7))


def test_reserved_names_are_those_of_columns_and_trackers(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write_episodes([EPISODE])
    columns = folder.metrics_path.read_text().splitlines()[0].split(",")
    for name in {*columns, *numbers(EPISODE)}:
        with pytest.raises(DescriptionError, match="give it another one"):
            check_measures([name], "metrics of a task")


@pytest.mark.parametrize(
    "name", ["speed, mean", 'the "best"', "measures", "return_", "ümlaut %", "error deg"]
)
def test_odd_names_of_measures_survive_metrics_csv(tmp_path: Path, name: str) -> None:
    folder = RunFolder(tmp_path)
    episodes = [
        dataclasses.replace(EPISODE, episode=number, measures={name: float(number)})
        for number in (1, 2, 3)
    ]
    folder.write_episodes(episodes[:1])
    for episode in episodes[1:]:
        folder.append(episode)
    assert [episode.measures for episode in folder.read_episodes()] == [
        {name: 1.0},
        {name: 2.0},
        {name: 3.0},
    ]


def test_simulation_refuses_a_reserved_metric_in_one_copy_and_in_many() -> None:
    for copies in (0, 2):
        env = SimulatedEnv(measuring("length"), Kinematics(0.05), batch_size=copies, seed=0)
        with pytest.raises(DescriptionError, match="have the name 'length'"):
            list(play_episodes(env, env.rand_action, 1, 0))


def test_metric_with_the_name_of_a_measure_of_the_walk_is_refused() -> None:
    env = bricksrl.make("RunAway-v0", seed=0)
    env.task = dataclasses.replace(
        env.task, max_steps=1, walks=True, metrics=lambda seen: {"forward_m": seen[..., 0].sum(-1)}
    )
    with pytest.raises(
        DescriptionError, match="have the name 'forward_m', which is measured of each virtual robot"
    ):
        list(play_episodes(env, env.rand_action, 1, 0))
    env.close(raise_if_closed=False)
