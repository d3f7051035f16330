"""Agent checker on our agents and wrong user agents."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.finding import Outcome
from bricksrl.evaluation.agent_checker import check_agent, is_agent

OWN = """
from dataclasses import dataclass, replace
import torch
from bricksrl.agents import td3
from bricksrl.agents.td3 import TD3Settings

@dataclass({frozen})
class Settings(TD3Settings):
    hidden: tuple[int, ...] = (16,)
    {field}

sgd = torch.optim.SGD


class Far(torch.nn.Module):
    in_keys = ("observation",)

    def forward(self, state):
        return state.set("action", state["observation"][..., :4] * 0 + 5)


def build(env, settings: Settings, device="cpu"):
    learner = td3.build(env, settings, device)
    {change}
    return learner
"""


def own(path: Path, *, change: str = "", field: str = "", frozen: str = "frozen=True") -> str:
    (path / "own.py").write_text(OWN.format(change=change, field=field, frozen=frozen))
    return str(path / "own.py")


@pytest.mark.parametrize("agent", ["sac", "ppo", "bc", "act", "random"])
def test_our_agents_pass_check(agent: str) -> None:
    checks = list(check_agent(agent))
    assert [check.name for check in checks] == [
        "settings",
        "build",
        "acting",
        "memory",
        "learning",
        "saving",
        "copies",
    ]
    assert [check for check in checks if check.outcome is Outcome.ERROR] == []
    # Each says what it found, or why it was left out.
    assert all(check.detail for check in checks), checks


def test_user_agent_passes_check(tmp_path: Path) -> None:
    assert {check.outcome for check in check_agent(own(tmp_path))} == {Outcome.OK}


@pytest.mark.parametrize(
    ("what", "name", "says"),
    [
        ({"field": "number: complex = 1j"}, "settings", "complex is not JSON"),
        (
            {"change": "learner.descent.optimizer = sgd([torch.nn.Parameter(torch.empty(0))])"},
            "build",
            "give the optimizer the loss's parameters",
        ),
        ({"change": "return 3"}, "build", "builds a int"),
        ({"change": "learner.policy = lambda state: state"}, "acting", "in_keys"),
        ({"change": "learner.policy = Far()"}, "acting", "-1..1"),
        ({"change": "learner.updates_per_step = 1e-9"}, "learning", "updates_per_step"),
        (
            {"change": "learner.descent.optimizer = sgd(learner.loss.parameters(), lr=0.0)"},
            "learning",
            "changed nothing",
        ),
        ({"change": "learner.loss.gamma = float('nan')"}, "learning", "not a number"),
        ({"change": "learner.state_dict = lambda: {'a': object()}"}, "saving", "object"),
    ],
)
def test_wrong_agent_fails_check(
    tmp_path: Path, what: dict[str, str], name: str, says: str
) -> None:
    failed = next(
        check for check in check_agent(own(tmp_path, **what)) if check.outcome is Outcome.ERROR
    )
    assert failed.name == name and says in failed.detail and "\n" not in failed.detail


def test_changed_settings_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(
        "from dataclasses import dataclass\nfrom bricksrl.agents import random\n"
        "@dataclass\nclass Settings:\n    rate: float = 1.0\n"
        "def build(env, settings: Settings, device='cpu'):\n"
        "    return random.build(env, settings, device)\n"
    )
    (check, *_) = check_agent(str(path))
    assert (check.outcome, check.name) == (
        Outcome.ERROR,
        "settings",
    ) and "frozen=True" in check.detail


def test_agent_file_differs_from_task_file(tmp_path: Path) -> None:
    task = tmp_path / "task.py"
    task.write_text(
        "from bricksrl.envs.tasks.spinning import SPINNING as TASK\n\n"
        "def make_task(*, fast=True):\n    return TASK\n"
    )
    assert is_agent("sac") and is_agent(own(tmp_path)) and is_agent(f"{own(tmp_path)}:build")
    assert not any(
        map(
            is_agent,
            (
                "Walker-v0",
                str(task),
                f"{task}:TASK",
                f"{task}:make_task",
                str(tmp_path / "none.py"),
            ),
        )
    )
