"""A policy conditioned on the physics: what it is told, in the mirror too, and as a structure to
search in."""

from __future__ import annotations

import dataclasses
from contextlib import closing

import pytest
import torch

from benchmarks.conditioned import ENTRIES, Conditioned, known, mirror_of, shares
from benchmarks.worlds import gains, totals
from bricksrl.agents import make_learner, preset
from bricksrl.envs.registry import get_task
from bricksrl.envs.transforms import layout_of

PLACES = {entry.name: index for index, entry in enumerate(ENTRIES)}


@pytest.mark.slow
def test_policy_is_told_the_physics_and_a_structure_acts_as_if_told_its_numbers() -> None:
    env = known(0, randomize=True)
    policy = make_learner("sac", env, dataclasses.replace(preset("default", "sac"), hidden=(8,)))
    structure, slopes = Conditioned(policy), []
    for _ in range(2):
        state = env.reset()
        physics = env.base_env.twin.body.physics
        numbers = torch.tensor([getattr(physics, entry.name) for entry in ENTRIES])
        assert torch.equal(state["observation"][8:], shares(numbers))
        slopes.append(physics.slope_deg)
        assert torch.equal(
            structure(state["observation"][:8], numbers), policy.exploit(state.clone())["action"]
        )
    assert slopes[0] != slopes[1] and -1.0 <= shares(numbers).min() <= shares(numbers).max() <= 1.0
    env.close()


def test_in_the_mirror_the_load_is_on_the_other_side_and_motors_have_each_others_strength() -> None:
    with closing(known(0)) as env:
        mirror = mirror_of(get_task("Walker-v1"), layout_of(env)).observation
    row = torch.arange(8.0 + len(ENTRIES))
    row[8:] = shares(torch.tensor([entry.low for entry in ENTRIES]))
    row[8 + PLACES["motor_1_scale"]], row[8 + PLACES["side_load_g"]] = 0.5, 0.25
    image = mirror(row)
    assert image[8 + PLACES["motor_2_scale"]] == 0.5 and image[8 + PLACES["motor_1_scale"]] == -1.0
    assert image[8 + PLACES["side_load_g"]] == -0.25
    assert torch.equal(mirror(image), row)


def test_what_is_lost_and_regained_is_summed_over_worlds() -> None:
    rows = [{"best": 10.0, **gains([(4.0, 9.0), (6.0, 7.0)]), "sac": gains([(2.0, 1.0)])}]
    assert totals(rows, "gait") == {"lost": 5.0, "regained": 3.0}
    assert totals(rows, "sac") == {"lost": 8.0, "regained": -1.0}
    assert rows[0]["standard_error"] == pytest.approx(2.0)
