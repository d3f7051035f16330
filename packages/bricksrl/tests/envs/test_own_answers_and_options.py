"""Options that are changed and refused, what an observation of another's client is cut to, and
reference returns."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from brickhub.entry import Entry
from bricksrl.envs.env import HubEnv
from bricksrl.envs.options import EnvOptions, parse_option
from bricksrl.envs.reference_returns import REFERENCES, reference_lines
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import DescriptionError
from bricktwin.twin.physics import Physics


def test_fields_are_changed_by_name_and_all_else_is_of_the_task() -> None:
    first = EnvOptions(hub="ble", options={"sparse": True})
    changed = first.changed(frame_skip=2, threshold_deg=20.0)
    assert (changed.hub, changed.frame_skip) == ("ble", 2)
    assert changed.options == {"sparse": True, "threshold_deg": 20.0}
    assert first.options == {"sparse": True} and first.frame_skip == 1
    assert first.changed(options={"a": 1}).options == {"a": 1}, "given as a whole"
    assert first.changed(sparse=False).options == {"sparse": False}
    assert changed.is_transformed and not first.is_transformed
    assert changed.transforms == {"frame_stack": 1, "frame_skip": 2, "transform": None}
    assert changed.as_it_is().transforms == first.transforms
    assert changed.as_it_is().options == changed.options


def test_options_without_effect_are_refused_where_they_are_given() -> None:
    options = EnvOptions(link="mac")
    options.refuse(["hub", "realtime"], "no effect")
    for names in (["link"], ["hub", "link"]):
        with pytest.raises(DescriptionError, match="^no effect$"):
            options.refuse(names, "no effect")


def test_physics_are_given_or_drawn() -> None:
    physics = Physics(battery_v=7.0)
    assert EnvOptions(physics=physics).known_physics == physics
    assert EnvOptions().known_physics is None
    with pytest.raises(DescriptionError) as caught:
        EnvOptions(physics=physics, randomize=True)
    says = "the physics is given and is to be random too; choose one of the two"
    assert str(caught.value) == says
    assert EnvOptions(physics="some.json").physics == Path("some.json")  # type: ignore[arg-type]


def test_numbers_of_arrays_and_single_faults_are_taken() -> None:
    options = EnvOptions(frame_skip=np.int64(3), fault="battery=6.2")  # type: ignore[arg-type]
    assert options.frame_skip == 3 and type(options.frame_skip) is int
    assert options.fault == ("battery=6.2",)
    assert EnvOptions(fault=["battery=6.2", "reversed:left"]).fault == (  # type: ignore[arg-type]
        "battery=6.2",
        "reversed:left",
    )
    for wrong in (0, 65, 1.5):
        with pytest.raises(DescriptionError, match=f"frame_stack is {wrong}; give"):
            EnvOptions(frame_stack=wrong)  # type: ignore[arg-type]
    for wrong in (0, 1001):
        with pytest.raises(DescriptionError, match=f"frame_skip is {wrong}; give"):
            EnvOptions(frame_skip=wrong)


@pytest.mark.parametrize("text", ["sparse", "=1", "1a=2", "a b=1", ""])
def test_text_that_is_no_option_is_told(text: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        parse_option(text)
    says = f"'{text}' is not an option; give NAME=VALUE, such as sparse=true"
    assert str(caught.value) == says


def client_of(*bounds: tuple[float, float], is_own: bool = True) -> Any:
    """An environment of which only its entries are known, and whether its client is a user's."""
    entries = tuple(Entry(f"state_{number}", *ends) for number, ends in enumerate(bounds))
    task = SimpleNamespace(id="Mine-v0", client="mine" if is_own else None, entries=entries)
    return SimpleNamespace(task=task, outside={})


def test_answers_of_an_own_client_are_cut_and_each_is_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    env = client_of((0.0, 10.0), (-1.0, 1.0), (0.0, 5.0))
    given = torch.tensor([12.0, -1.5, 5.0])
    with caplog.at_level(logging.WARNING):
        cut = HubEnv._within(env, given)
        assert cut.tolist() == [10.0, -1.0, 5.0] and given.tolist() == [12.0, -1.5, 5.0]
        again = HubEnv._within(env, torch.tensor([-3.0, math.nan, math.inf]))
    assert again[0] == 0.0 and again[1].isnan() and again[2].isinf()
    assert env.outside == {"state_0": 12.0, "state_1": -1.5}
    assert caplog.messages == [
        "Mine-v0: state_0 is 12, outside of 0 to 10; it is cut to this range from now on",
        "Mine-v0: state_1 is -1.5, outside of -1 to 1; it is cut to this range from now on",
    ]
    ours = client_of((0.0, 10.0), is_own=False)
    assert HubEnv._within(ours, given[:1]) is not None
    assert HubEnv._within(ours, given[:1]).tolist() == [12.0] and ours.outside == {}


def test_reference_returns_are_of_the_tasks_as_they_are() -> None:
    for env_id in ("RunAway-v0", "Walker-v0", "RoboArm-v0"):
        lines = reference_lines(env_id)
        assert lines == REFERENCES[env_id] and {"random", "by hand"} <= lines.keys()
        assert lines["by hand"] > lines["random"]
        assert reference_lines(env_id, {}) == lines
        assert reference_lines(env_id, {"sparse": True}) == {}
    assert reference_lines("Mine-v0") == {}


def test_task_without_an_aim_has_no_goal_and_one_with_a_joint_s_has_it() -> None:
    from bricksrl.envs.task import SampledEntry

    task = replace(SPINNING, sampled_entries=(SampledEntry("left_goal", 0.0, 90.0),))
    goal = task.goal([0.0] * 5 + [45.0])
    assert goal is not None and goal.angles_deg == {"left": 45.0}
    assert SPINNING.goal([0.0] * 6) is None
