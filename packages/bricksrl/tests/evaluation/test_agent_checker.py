"""Agent checker on our agents and wrong user agents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tensordict import TensorDict

from brickhub.finding import Outcome
from bricksrl.agents import make_learner, preset
from bricksrl.envs import make
from bricksrl.envs.env_checker import Broken, Skip
from bricksrl.evaluation import agent_checker
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


@dataclass(frozen=True)
class Plain:
    rate: float = 1.0
    hidden: tuple[int, ...] = (8, 4)


@dataclass(frozen=True)
class Without:
    rate: float
    units: int
    word: str = ""


@dataclass
class Changeable:
    rate: float = 1.0


def checked(**algorithm: Any) -> Any:
    """Checks of an algorithm that nobody has built."""
    return agent_checker._Checked(SimpleNamespace(name="own", **algorithm))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (Changeable, "Changeable can be changed; write @dataclass"),
        (Without, "rate, units has no default; give it one"),
    ],
)
def test_settings_are_frozen_and_have_defaults(settings: type, says: str) -> None:
    with pytest.raises(Broken, match=says):
        checked(settings=settings).settings()


@pytest.mark.parametrize(
    ("read", "given", "says"),
    [
        (Plain(), Plain(), None),
        (Plain(rate=2.0), Plain(), "written down and read again are others"),
        (Plain(), Plain(hidden=(8,)), "given as --set NAME=VALUE are others"),
    ],
)
def test_settings_come_back_from_a_file_and_from_texts(
    monkeypatch: pytest.MonkeyPatch, read: Plain, given: Plain, says: str | None
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(agent_checker, "preset", lambda *_: Plain())
    monkeypatch.setattr(agent_checker, "settings_from", lambda *about: asked.append(about) or read)
    monkeypatch.setattr(agent_checker, "with_changes", lambda *about: asked.append(about) or given)
    check = checked(settings=Plain).settings
    if says is not None:
        with pytest.raises(Broken, match=says):
            check()
        return
    assert check() == "2 settings, which can be written down and read"
    assert asked == [
        ("own", {"rate": 1.0, "hidden": [8, 4]}),
        (Plain(), ["rate=1.0", "hidden=8,4"]),
    ]


def learner(**parts: Any) -> Any:
    usual = {
        "policy": SimpleNamespace(in_keys=["observation"]),
        "reset_policy": lambda: None,
        "needs_dataset": False,
        "updates_per_step": 1.0,
        "updates": 3,
        "remember": lambda _frames: None,
        "state_dict": dict,
        "load_state_dict": lambda _state: None,
    }
    return SimpleNamespace(**usual | parts)


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], None]:
    """Let checks make a learner, and an environment with actions of two numbers."""
    state = TensorDict({"observation": torch.zeros(3)})
    env = SimpleNamespace(reset=lambda: state, action_spec=SimpleNamespace(shape=torch.Size([2])))
    monkeypatch.setattr(agent_checker, "make", lambda *_, **__: env)
    monkeypatch.setattr(agent_checker, "_frames", lambda *_: None)
    return lambda made: monkeypatch.setattr(agent_checker, "make_learner", lambda *_: made)


@pytest.mark.parametrize(
    ("explored", "exploited", "says"),
    [
        ([1.0, -1.0], [0.5, 1.0], None),
        ([0.0], [0.0, 0.0], r"an action has the shape \[1\]; give \[2\]"),
        ([0.0, 0.0], [0.0, 0.0, 0.0], r"an action has the shape \[3\]; give \[2\]"),
        ([0.0, -1.01], [0.0, 0.0], "numbers in -1..1"),
        ([0.0, 0.0], [1.5, 0.0], "numbers in -1..1"),
        ([0.0, float("nan")], [0.0, 0.0], "numbers in -1..1"),
    ],
)
def test_an_agent_acts_within_the_range_exploring_and_not(
    stage: Callable[[Any], None], explored: list[float], exploited: list[float], says: str | None
) -> None:
    stage(None)
    one = checked()
    one.learner = learner(
        explore=lambda _: {"action": torch.tensor(explored)},
        exploit=lambda _: {"action": torch.tensor(exploited)},
    )
    if says is None:
        assert one.acting() == "actions of 2 numbers in -1..1, exploring and not"
        return
    with pytest.raises(Broken, match=says):
        one.acting()


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"learn": lambda _: {"loss": torch.tensor(1.0)}}, None),
        ({"learn": lambda _: {}}, "what it learns from 3 copies is nothing"),
        (
            {"learn": lambda _: {"a": torch.tensor(1.0), "loss": torch.tensor(float("nan"))}},
            "what it learns from 3 copies is .*nan",
        ),
        ({"needs_dataset": True}, "does not learn from a robot"),
        ({"updates_per_step": 0.0}, "does not learn from a robot"),
    ],
)
def test_an_agent_learns_from_copies_side_by_side(
    stage: Callable[[Any], None], parts: dict[str, Any], says: str | None
) -> None:
    stage(learner(**parts))
    if says is None:
        assert checked().copies() == "3 updates from 3 copies side by side"
        return
    with pytest.raises(Broken if "learn" in parts else Skip, match=says):
        checked().copies()


@pytest.mark.parametrize("restored", [[0.25, 0.5], [0.25, 0.25]])
def test_a_saved_agent_acts_as_before(stage: Callable[[Any], None], restored: list[float]) -> None:
    action = torch.tensor([0.25, 0.5])
    stage(learner(exploit=lambda _: {"action": torch.tensor(restored)}))
    one = checked()
    one.learner = learner(exploit=lambda _: {"action": action})
    if restored == action.tolist():
        assert one.saving().endswith(" bytes, and the same actions from them")
        return
    with pytest.raises(Broken, match="a learner that is saved and restored acts otherwise"):
        one.saving()


def test_checks_are_left_out_where_there_is_nothing_to_check() -> None:
    one = checked()
    for check in (one.acting, one.memory, one.learning, one.saving):
        with pytest.raises(Skip, match="there is no learner"):
            check()
    one.learner = learner()
    with pytest.raises(Skip, match="it remembers nothing"):
        one.memory()
    with pytest.raises(Skip, match="it learns nothing"):
        one.learning()


@pytest.mark.parametrize(
    ("name", "updates_per_step", "steps"),
    [
        ("td3", 1.0, 4),
        ("td3", 0.5, 8),
        ("td3", 4.0, 2),
        ("td3", 20.0, 2),
        ("td3", 1e-3, 1000),
        ("ppo", None, 40),
    ],
)
def test_an_agent_learns_for_as_many_steps_as_four_updates_need(
    name: str, updates_per_step: float | None, steps: int
) -> None:
    one = checked()
    made: Any = make_learner(name, make(agent_checker.ENV, seed=0))
    asked: list[int] = []
    made.learn = lambda count: asked.append(count) or {}
    made.make_updates = lambda count: asked.append(-count)
    if updates_per_step is not None:
        made.updates_per_step = updates_per_step
    one.learner = made
    with pytest.raises(Broken) as raised:
        one.learning()
    assert str(raised.value) == "nothing was learned; fill the memory, and give updates_per_step"
    assert asked == [0, steps], "what comes before the first update is no learning"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("td3", "40 rows of 40 steps or more"),
        ("bc", "40 transitions of a dataset"),
        ("ppo", "40 rows of 40 steps or more"),
    ],
)
def test_memory_has_the_steps_that_were_made(name: str, says: str) -> None:
    one = checked()
    env = make(agent_checker.ENV, seed=0)
    settings = replace(preset("default", name), steps=40) if name == "ppo" else None
    one.learner = make_learner(name, env, settings)
    assert one.memory() == says
    if name == "td3":
        one.learner.remember = lambda _frames: None
        one.learner.memory.empty()
        with pytest.raises(Broken, match="the memory is empty after transitions were remembered"):
            one.memory()
