"""Each difference from the paper has the paper's way (docs/paper.md)."""

from __future__ import annotations

import re
from contextlib import closing
from pathlib import Path

import pytest
import torch

import bricksrl
from bricksrl.agents import preset
from bricksrl.envs.options import parse_option
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import Kinematics
from bricksrl.errors import DescriptionError
from bricksrl.evaluation.settings_text import with_changes

PAGE = Path(__file__).parents[4] / "docs" / "paper.md"
OF_SETTINGS = {"settings": "sac", "inputs of the networks": "td3", "DroQ": "droq", "updates": "sac"}


def ways() -> list[tuple[str, str]]:
    """Subject and way of each row of the page that names options or settings."""
    rows = [
        [cell.strip() for cell in line.split("|")]
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    return [(row[1], row[5]) for row in rows if len(row) == 7 and "`--" in row[5]]


@pytest.mark.parametrize(("subject", "way"), ways())
def test_what_the_page_says_is_taken(subject: str, way: str) -> None:
    options = dict(map(parse_option, re.findall(r"--option ([^\s`]+)", way)))
    if options:
        names = {"Walker": "Walker-v0", "RoboArm": "RoboArm-v0"}
        first = re.split(r"\W ", subject, maxsplit=1)[0]
        get_task(names.get(first, first), **options)
    elif subject in OF_SETTINGS:
        paper = preset("paper", OF_SETTINGS[subject])
        changed = with_changes(paper, re.findall(r"--set ([^\s`]+)", way))
        assert (
            changed != paper
            or "part of `--preset paper`" in way
            or subject in ("settings", "updates")
        )
    else:
        assert way == "`--hub ble`"


def at_distance(*distances_mm: float) -> torch.Tensor:
    observations = torch.zeros(len(distances_mm), 5)
    observations[:, 4] = torch.tensor(distances_mm)
    return observations


def legs(step_deg: float, *, apart_deg: float = 180.0, steps: int = 50) -> torch.Tensor:
    """An episode of the Walker whose diagonal legs move together."""
    turned = -step_deg * torch.arange(steps + 1.0)
    angles = torch.stack([turned, turned + apart_deg, turned + apart_deg, turned], -1) % 360.0
    return torch.cat((angles, torch.zeros(steps + 1, 3)), -1)


def test_wall_only_costs() -> None:
    ours, papers = get_task("RunAway-v0"), get_task("RunAway-v0", ends_at_wall=False)
    near, nearer = at_distance(60.0), at_distance(40.0)
    assert [task.reward(near, torch.zeros(1, 1), nearer).item() for task in (ours, papers)] == [
        0.0,
        -1.0,
    ]
    assert [task.terminated(nearer).item() for task in (ours, papers)] == [True, False]
    assert papers.terminated(at_distance(2000.0)).item()


def test_tilt_ends_no_episode() -> None:
    ours, papers = get_task("Walker-v0"), get_task("Walker-v0", safe_tilt_deg=180)
    tilted = torch.tensor([[0.0, 180.0, 180.0, 0.0, 89.0, 0.0, 2000.0]])
    assert [task.terminated(tilted).item() for task in (ours, papers)] == [True, False]
    with pytest.raises(DescriptionError, match="safe_tilt_deg is 0; give more than 0"):
        get_task("Walker-v0", safe_tilt_deg=0)


def test_two_steps_a_second_for_a_hundred_steps() -> None:
    task = get_task("Walker-v0", step_ms=500, max_steps=100)
    assert (task.interface.settle.fixed_ms, task.max_steps) == (500, 100) and get_task(
        "Walker-v0", step_ms=500
    ).max_steps == 50
    with closing(bricksrl.make("Walker-v0", seed=0, step_ms=500, max_steps=3)) as env:
        assert len(env.rollout(10)) == 3
    with pytest.raises(DescriptionError, match="max_steps is 0; give 1 or more"):
        get_task("Walker-v0", max_steps=0)


def test_noise_is_on_the_angles() -> None:
    env = bricksrl.make(
        "WalkerSim-v0",
        seed=0,
        batch_size=2000,
        kinematics=Kinematics(noise=0.002, noise_on="state"),
    )
    before = env.reset()
    # 1 does not turn a leg
    after = env.step(before.set("action", torch.ones(2000, 4)))["next", "observation"][:, :4]
    moved = (after - before["observation"][:, :4] + 180.0) % 360.0 - 180.0
    assert moved.std().item() == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    ("episode", "succeeds"),
    [
        (legs(90.0), True),
        (legs(20.0), False),  # hardly moves
        (legs(-90.0), False),  # backwards
        (legs(90.0, apart_deg=135.0), False),  # no trot
        (legs(90.0)[:1], False),
    ],
)
def test_success_of_the_walker_is_to_trot(episode: torch.Tensor, succeeds: bool) -> None:
    assert get_task("Walker-v0").success(episode).item() is succeeds
    assert get_task("WalkerSim-v0").success(episode).item() is succeeds


def test_goal_of_the_arm_is_as_narrow_as_asked() -> None:
    beside = torch.tensor([[90.0, 40.0, -70.0, -95.0, 120.0, 40.0, -70.0, -95.0]])
    assert [
        get_task("RoboArm-v0", threshold_deg=limit).terminated(beside).item()
        for limit in (50.0, 20.0)
    ] == [True, False]


def test_preset_has_the_papers_settings() -> None:
    found = preset("paper", "sac")
    assert (found.angles, found.goals, found.updates_per_step, found.learning_rate) == (
        "raw",
        "plain",
        1.0,
        3e-4,
    )


@pytest.mark.parametrize(
    ("share_of_chance", "return_", "least", "most"),
    [(0.0, -12, 0.9, 1.0), (0.38, -53, 0.0, 0.5), (1.0, -200, 0.0, 0.05)],
)
def test_success_tells_a_trot_from_chance(
    share_of_chance: float, return_: float, least: float, most: float
) -> None:
    """-52 is the return of the paper's SAC on its robot."""
    copies, generator = 300, torch.Generator().manual_seed(0)
    env = bricksrl.make("WalkerSim-v0", seed=1, batch_size=copies)
    state, observations, returns = env.reset(), list[torch.Tensor](), torch.zeros(copies)
    for _ in range(100):
        angles = state["observation"][:, :4]
        ahead = (
            angles - angles[:, :1] - torch.tensor([0.0, 180.0, 180.0, 0.0]) + 180.0
        ) % 360.0 - 180.0
        trot = (-0.3 - ahead / 50.0).clamp(-1.0, 1.0)
        drawn = torch.rand(copies, 4, generator=generator) * 2.0 - 1.0
        is_chance = torch.rand(copies, 1, generator=generator) < share_of_chance
        state = env.step(state.set("action", torch.where(is_chance, drawn, trot)))["next"]
        observations.append(state["observation"])
        returns += state["reward"][:, 0]
    assert returns.mean().item() == pytest.approx(return_, abs=4)
    assert (
        least
        <= get_task("WalkerSim-v0").success(torch.stack(observations, 1)).float().mean().item()
        <= most
    )
