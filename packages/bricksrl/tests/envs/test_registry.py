"""Environments by name."""

from __future__ import annotations

import dataclasses
import inspect
from pathlib import Path
from typing import Any

import gymnasium
import pytest
import torch

import bricksrl
from bricksrl.envs import get_task
from bricksrl.envs.options import parse_option
from bricksrl.envs.registry import ARGUMENTS
from bricksrl.envs.task import Kinematics
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.errors import DescriptionError, RunError, UnknownNameError


def test_list_describes_each_environment() -> None:
    envs = bricksrl.list_envs()
    assert {"RunAway-v0", "Spinning-v0"} <= set(envs)
    assert "wall" in envs["RunAway-v0"]
    assert list(envs) == sorted(envs)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("RunAway", "RunAway-v0"),
        ("runaway-v0", "RunAway-v0"),
        ("Spining-v0", "Spinning-v0"),
        ("Chess-v5", None),
    ],
)
def test_unknown_environment_lists_known_ones(name: str, meant: str | None) -> None:
    with pytest.raises(UnknownNameError, match=f"no environment '{name}'") as caught:
        bricksrl.make(name)
    message = str(caught.value)
    assert "RunAway-v0, " in message
    assert "\n" not in message
    assert (f"did you mean '{meant}'?" in message) is (meant is not None)


@pytest.mark.parametrize(
    "name", [None, 3, b"Walker-v0", Path("my_task.py"), ["Walker-v0"], RUN_AWAY]
)
def test_id_of_another_type_raises(name: Any) -> None:
    for wrong in (bricksrl.make, get_task):
        with pytest.raises(DescriptionError, match="env_id is .*; give a text") as caught:
            wrong(name)
        assert len(str(caught.value)) < 60


@pytest.mark.parametrize(
    "option",
    [
        {"hub": None},
        {"hub": 3},
        {"realtime": "yes"},
        {"physics": {"a": 1}},
        {"options": {"hub": "usb"}},
        {"options": 3},
    ],
)
def test_options_of_another_type_raise(option: Any) -> None:
    with pytest.raises(DescriptionError, match=f"{next(iter(option))} is .*; give"):
        bricksrl.make("RunAway-v0", **option)


def test_unknown_device_raises() -> None:
    with pytest.raises(RunError, match="there is no device 'gpu' here; choose cpu.* or auto"):
        bricksrl.make("WalkerSim-v0", device="gpu")


def test_unknown_hubs_raise() -> None:
    for hub in ("wifi", "ble:", "virtual:2", ""):
        with pytest.raises(UnknownNameError, match="choose 'virtual', 'ble' or 'usb'"):
            bricksrl.make("RunAway-v0", hub=hub)
    with pytest.raises(DescriptionError, match="its own time"):
        bricksrl.make("RunAway-v0", hub="ble", realtime=True)


def test_user_tasks_cannot_replace_built_in() -> None:
    with pytest.raises(DescriptionError, match="comes with BricksRL"):
        bricksrl.register(dataclasses.replace(RUN_AWAY, max_steps=5))
    mine = dataclasses.replace(RUN_AWAY, id="Mine-v0")
    bricksrl.register(mine)
    assert get_task("Mine-v0") is mine
    bricksrl.register(dataclasses.replace(mine, max_steps=7))
    assert get_task("Mine-v0").max_steps == 7
    assert gymnasium.spec("bricksrl/Mine-v0").max_episode_steps == 7


def test_arguments_of_each_kind_are_those_of_make() -> None:
    named = set(inspect.signature(bricksrl.make).parameters) - {"env_id", "options", "named"}
    assert {name for names in ARGUMENTS.values() for name in names} == named


@pytest.mark.parametrize(
    ("env_id", "named", "says"),
    [
        ("WalkerSim-v0", {"copies": 0}, "copies are 1 or more"),
        ("WalkerSim-v0", {"copies": 2, "batch_size": 2}, "give either copies or batch_size"),
        ("WalkerSim-v0", {"arrays": True}, "has no robot that works with arrays alone"),
        ("RunAway-v0", {"arrays": True, "frame_skip": 2}, "has no robot that works with arrays"),
        ("RunAway-v0", {"arrays": True, "copies": 2}, "with arrays is one robot"),
        ("RunAway-v0", {"arrays": True, "device": "cuda"}, "with arrays is one robot"),
        ("RunAway-v0", {"batch_size": 0}, "is one robot; omit batch_size"),
        ("RunAway-v0", {"batch_size": []}, "is one robot; omit batch_size"),
    ],
)
def test_what_cannot_be_made_together_raises(env_id: str, named: Any, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        bricksrl.make(env_id, **named)


def test_copies_of_a_robot_have_no_device() -> None:
    with pytest.raises(RunError, match="cannot make 2 copies of RunAway-v0: .* omit batch_size"):
        bricksrl.make("RunAway-v0", copies=2, device="cuda")


def test_copies_of_a_simulation_count() -> None:
    copies = bricksrl.make("WalkerSim-v0", copies=3, seed=0)
    state = copies.rollout(2)["next"]
    assert state["step_count"].shape == (3, 2, 1)
    assert torch.equal(state["episode_reward"][:, -1], state["reward"].sum(1))


def test_copies_have_the_seed_and_the_kinematics_that_were_given() -> None:
    def legs(seed: int, noise: float) -> torch.Tensor:
        env = bricksrl.make("WalkerSim-v0", copies=3, seed=seed, kinematics=Kinematics(noise))
        state = env.reset()
        after = env.step(state.set("action", torch.zeros(3, 4)))["next", "observation"]
        return torch.stack((state["observation"], after))[..., :4]

    assert torch.equal(legs(1, 0.1), legs(1, 0.1))
    assert not torch.equal(legs(1, 0.1), legs(2, 0.1))
    exact = legs(1, 0.0)
    turned = (exact[0] - exact[1]).remainder(360.0)
    assert torch.allclose(turned, torch.tensor(50.0), atol=1e-3), "half of 100 degrees"
    noisy = legs(1, 0.1)
    assert torch.equal(noisy[0], exact[0]) and not torch.allclose(noisy[1], exact[1])


def test_arenas_are_made_elsewhere() -> None:
    with pytest.raises(
        UnknownNameError,
        match="has several robots; train it with `bricksrl team .*`, make it with "
        "bricksrl.make_arena",
    ):
        bricksrl.make("Tag-v0")


@pytest.mark.parametrize("attempt", range(2))
def test_environments_of_another_test_are_unknown(attempt: int) -> None:
    with pytest.raises(UnknownNameError):
        get_task("Leaked-v0")
    bricksrl.register(dataclasses.replace(RUN_AWAY, id="Leaked-v0"))


OPTIONS = """
from __future__ import annotations
import enum
from dataclasses import replace
from typing import Literal, Optional
from bricksrl.envs import get_task

class Colour(enum.Enum):
    RED = "red"

def task(cost: float = 0.1, count: int = 5, sure: bool = False, kind: Literal["a", "b"] = "a",
         name: str = "x", size: tuple[float, float] = (1, 2), goal: Optional[float] = None,
         mode: Literal[1, 2] | None = None, colour: Colour = Colour.RED, free=0.5, anything=None):
    return replace(get_task("RunAway-v0"), id="O-v0", doc=repr((name, size, colour)))

def needs(cost: float, where):
    return task(cost)
"""


@pytest.mark.parametrize(
    ("option", "wanted"),
    [
        ("cost=viel", "cost is 'viel'; give a number"),
        ("cost=true", "cost is True; give a number"),
        ("cost=NaN", "cost is nan; give a number"),
        ("cost=null", "cost is None; give a number"),
        ("cost=1", None),
        ("count=2.5", "count is 2.5; give a whole number"),
        ("sure=yes", "sure is 'yes'; give True or False"),
        ("kind=c", "kind is 'c'; choose a or b"),
        ("name=1.5", "name is 1.5; give a text"),
        ("name=5", None),
        ("size=[1]", "size is (1,); give 2 values, each a number"),
        ("size=[3, 4]", None),
        ("goal=x", "goal is 'x'; give a number"),
        ("goal=null", None),
        ("mode=3", "mode is 3; give 1 or 2"),
        ("colour=green", "colour is 'green'; give Colour.RED"),
        ("colour=red", None),
        ("free=x", "free is 'x'; give a number"),
        ("anything=x", None),
    ],
)
def test_option_is_what_its_annotation_says(
    tmp_path, monkeypatch, option: str, wanted: str | None
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "opts.py").write_text(OPTIONS)
    named = dict([parse_option(option)])
    if wanted is None:
        get_task("opts.py:task", **named)
        return
    with pytest.raises(DescriptionError) as caught:
        get_task("opts.py:task", **named)
    assert str(caught.value) == f"opts.py:task: {wanted}"


def test_missing_and_unknown_options_are_named(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "opts.py").write_text(OPTIONS)
    with pytest.raises(
        DescriptionError, match=r"an option is missing; give cost \(a number\), where"
    ):
        get_task("opts.py:needs")
    assert "('5', (3, 4), " in get_task("opts.py:task", name=5, size=[3, 4]).doc
    with pytest.raises(
        TypeError,
        match=r"no option batchsize \(did you mean 'batch_size'\?\); .*batch_size, device",
    ):
        bricksrl.make("WalkerSim-v0", batchsize=32)
    with pytest.raises(
        TypeError,
        match=r"no option hubb \(did you mean 'hub'\?\); its task has ends_at_wall, .*hub,",
    ) as unknown:
        bricksrl.make("RunAway-v0", hubb="ble")
    # TorchRL's wrapper of Gymnasium tries options, and takes these words for a refusal.
    assert "unexpected keyword argument 'hubb'" in str(unknown.value)
