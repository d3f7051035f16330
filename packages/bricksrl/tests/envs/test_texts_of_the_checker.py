"""What the checker of environments says, and what it doubts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

from bricksrl.envs import env_checker
from bricksrl.envs.env import outside_text
from bricksrl.envs.env_checker import _cells, _first_wrong, _functions, _values_of, check_env, table
from bricksrl.envs.registry import get_task
from bricksrl.envs.simulation import SimulatedEnv
from bricksrl.envs.task import Kinematics
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import BricksError


def test_tables_of_a_description_are_read_cell_by_cell() -> None:
    doc = (
        "Spins.\n\n## Action\n\n| Num | Name | Min | Max | Unit |\n|---|---|---|---|---|\n"
        "| 0 | left | -1 | 1.5 | deg |\n| 1 | right | all | 2 | |\n\n## End\n\n| a | b |\n"
    )
    rows = table(doc, "Action")
    assert rows == [["0", "left", "-1", "1.5", "deg"], ["1", "right", "all", "2", ""]]
    assert table(doc, "Reward") == table(doc, "End") == []
    assert [_values_of(row) for row in rows] == [
        ("0", "left", -1.0, 1.5, "deg"),
        ("1", "right", "all", 2.0, ""),
    ]
    assert _values_of(["0", "left"]) == ("0", "left")
    assert _cells("| a |b | c|") == ["a", "b", "c"]
    wanted: list[Any] = [("0", 1.0), ("1", 2.0)]
    assert _first_wrong([("0", 1.0), ("1", 3.0)], wanted) == ("1", 3.0)
    assert _first_wrong([("0", 1.0)], wanted) == "1 rows in place of 2"


def test_functions_of_a_task_are_tried_with_numbers_in_their_ranges() -> None:
    given_: list[Any] = []

    def reward(previous: Any, action: Any, observation: Any) -> Any:
        given_.extend((previous, action, observation))
        return SPINNING.reward(previous, action, observation)

    said = _functions(replace(SPINNING, reward=reward))
    names = "reward, terminated, blocked, success, mean_yaw_rate_deg_s"
    assert said == f"{names} have the right shapes"
    before, action, after = given_
    low = torch.tensor([entry.low for entry in SPINNING.entries])
    high = torch.tensor([entry.high for entry in SPINNING.entries])
    for observations in (before, after):
        assert observations.shape == (5, 6)
        assert bool(((observations >= low) & (observations <= high)).all())
        assert bool((observations.amax(0) - observations.amin(0) > 0.3 * (high - low)).all())
    assert not torch.equal(before, after)
    assert action.shape == (5, 2) and action.min() < -0.3 and action.max() > 0.3
    assert action.abs().max() <= 1.0


def test_check_of_a_simulation_says_what_it_found() -> None:
    found = {finding.name: finding.detail for finding in check_env("RoboArmSim-v0")}
    described = found.pop("description")
    assert described == "the tables (action, observation, end of an episode) fit the task"
    assert found.pop("functions") == (
        "reward, terminated, blocked, success, error_sum_deg have the right shapes"
    )
    program = found.pop("hub program")
    assert program.split()[1:] == ["of", "the", "prime", "hub's", program.split()[5], "bytes"]
    assert found.pop("specs") == "observation [8], action [4]"
    assert found.pop("reset").startswith("twice, the observation starts with [")
    assert found.pop("determinism") == "the same seed and actions repeat 5 steps bit for bit"
    assert found.pop("twin") == "it is simulated without a robot"
    values = "random steps all entries and the reward changed, and each action changed something"
    assert found.pop("values").split(maxsplit=2)[2] == values
    assert found == {}


def test_check_of_a_robot_says_what_moved() -> None:
    found = {finding.name: finding.detail for finding in check_env("Spinning-v0")}
    assert found["twin"].startswith("five steps in ")
    assert found["twin"].endswith(" entries changed")
    elapsed_s = float(found["twin"].split()[3])
    # Five steps of 100 ms and what goes over the air.
    assert 0.6 < elapsed_s < 1.4
    changed, of, count = found["twin"].split()[6:9]
    assert of == "of" and 3 <= int(changed) < int(count) == 6
    assert found["values"].startswith("in 30 random steps all entries and the reward changed")


def checked_values(task: Any, monkeypatch: pytest.MonkeyPatch) -> str:
    """What the check of values says of the simulation of a task."""

    def make(_env_id: str, seed: int) -> Any:
        return SimulatedEnv(task, Kinematics(0.0), seed=seed)

    monkeypatch.setattr(env_checker, "make", make)
    return env_checker._values(task.id, task)


def test_values_that_never_change_are_doubtful_each_in_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    walker = get_task("WalkerSim-v1")
    with pytest.raises(env_checker.Doubtful) as caught:
        checked_values(walker, monkeypatch)
    still = (
        "pitch (0), roll (0), distance (0) never changed; look at the sensor and the scene, or "
        "leave it out"
    )
    assert str(caught.value) == still
    first, second, *others = walker.interface.commands
    idle = (replace(first, low=-50.0, high=-50.0), replace(second, low=0.0, high=0.0), *others)
    dull = replace(
        walker,
        interface=replace(walker.interface, commands=idle),
        symmetric=False,
        reward=lambda previous, action, observation: 2.5 + 0.0 * observation[..., :1],
    )
    with pytest.raises(env_checker.Doubtful) as caught:
        checked_values(dull, monkeypatch)
    assert str(caught.value) == (
        f"{still}; the reward was always 2.5; nothing can be learned from it; action left_front, "
        "right_front changed nothing; look at its port, its range and its units"
    )


def test_value_that_is_no_number_or_out_of_its_range_is_broken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Wrong(SimulatedEnv):
        outside: dict[str, float] = {}  # noqa: RUF012  each test sets it

        def _step(self, tensordict: Any) -> Any:
            out = super()._step(tensordict)
            out["observation"][1] = torch.nan
            return out

    task = get_task("RoboArmSim-v0")
    monkeypatch.setattr(
        env_checker, "make", lambda _id, seed: Wrong(task, Kinematics(0.0), seed=seed)
    )
    with pytest.raises(env_checker.Broken) as caught:
        env_checker._values(task.id, task)
    assert str(caught.value) == ("low_angle is not always a number (NaN); correct what computes it")
    monkeypatch.setattr(Wrong, "outside", {"low_angle": 99.0, "grab_angle": 0.5})
    with pytest.raises(env_checker.Broken) as caught:
        env_checker._values(task.id, task)
    low, grab = task.entries[1], task.entries[3]
    texts = [outside_text(low, 99.0), outside_text(grab, 0.5)]
    assert str(caught.value) == f"{', '.join(texts)}; correct the client, or the range"


def test_first_observation_is_of_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    class Unknown(SimulatedEnv):
        def _reset(self, tensordict: Any = None, **named: Any) -> Any:
            state = super()._reset(tensordict, **named)
            state["observation"][2:] = torch.nan
            state["observation"][:2] = 1.25
            return state

    task = get_task("RoboArmSim-v0")
    monkeypatch.setattr(
        env_checker, "make", lambda _id, seed: Unknown(task, Kinematics(0.0), seed=seed)
    )
    with pytest.raises(env_checker.Broken) as caught:
        env_checker._reset(task.id)
    numbers = f"[1.25, 1.25, {', '.join(['nan'] * 6)}]"
    says = f"the observation holds {numbers}; all entries have to be numbers"
    assert str(caught.value) == says


def test_checks_are_told_by_what_they_raise() -> None:
    def fail(error: Exception) -> Any:
        def check() -> str:
            raise error

        return check

    found = env_checker.run_checks(
        {
            "one": lambda: "fine",
            "two": fail(env_checker.Skip("not here")),
            "three": fail(env_checker.Doubtful("odd")),
            "four": fail(env_checker.Broken("wrong\n  twice")),
            "five": fail(BricksError("wrong twice")),
            "six": fail(ValueError("a bug")),
            "seven": fail(ValueError("a bug")),
        }
    )
    told = [(one.name, one.outcome.value, one.detail) for one in found]
    assert told[:5] == [
        ("one", "ok", "fine"),
        ("two", "skipped", "not here"),
        ("three", "warning", "odd"),
        ("four", "error", "wrong twice"),
        ("five", "error", "the same as in four"),
    ]
    assert told[5][1] == "error" and told[5][2].startswith("ValueError: a bug")
    assert told[6] == ("seven", "error", "the same as in six")
