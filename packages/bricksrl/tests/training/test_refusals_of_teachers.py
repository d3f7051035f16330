"""What cannot teach an agent, or be learned from, and the sentence that says so."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from toys import Cart

from bricksrl.agents import make_learner, preset
from bricksrl.data import About, Recorder, Step, describe
from bricksrl.envs import make
from bricksrl.errors import BricksError, DivergedError, RunError
from bricksrl.training import RunFolder, TrainConfig, learners
from bricksrl.training.learners import (
    attach_dataset,
    base_for,
    check_weights,
    one_robot,
    read_for,
    teacher_of,
)

CART = TrainConfig("Cart", settings=preset("default", "sac"))


def run_of(path: Path, config: TrainConfig) -> Path:
    """A folder of a run that has a config alone."""
    path.mkdir(parents=True)
    RunFolder(path).write_config(config)
    return path


def refused(function: Any, *given: Any, **named: Any) -> str:
    """What is said when it is refused."""
    with pytest.raises(BricksError) as raised:
        function(*given, **named)
    return str(raised.value)


def test_config_of_one_robot_is_the_first_on_the_processor() -> None:
    fleet = TrainConfig("RunAway-v0", hub="ble:A, ble:B", device="cuda")
    one = one_robot(fleet)
    assert (one.hub, one.robots, one.num_envs, one.device) == ("ble:A", 1, 1, "cpu")
    copies = one_robot(TrainConfig("WalkerSim-v0", num_envs=7))
    assert (copies.hub, copies.num_envs) == ("virtual", 1)


def test_base_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    env = Cart()
    scripted = dataclasses.replace(CART, base="scripted")
    assert refused(base_for, scripted, env) == (
        "Cart has no hand-written controller; give the folder of a run as base"
    )
    walker = TrainConfig("WalkerSim-v0", base="scripted")
    stacked = make("WalkerSim-v0", seed=0, frame_stack=2)
    assert refused(base_for, walker, stacked) == (
        "the hand-written controller acts on what the robot itself observes; omit the transforms"
    )
    remembering = SimpleNamespace(learner=SimpleNamespace(policy=SimpleNamespace(reset=print)))
    monkeypatch.setattr(learners, "load_learner", lambda path, env: remembering)
    chunked = dataclasses.replace(CART, base="runs/act")
    assert refused(base_for, chunked, env) == (
        "the policy of runs/act depends on more than what it observes; choose another base"
    )


@pytest.mark.parametrize(
    ("agent", "given", "message"),
    [
        (
            "bc",
            {},
            "bc needs demonstrations; give their folder, or use `bricksrl train-offline`",
        ),
        (
            "random",
            {"demonstrations": "walk"},
            "the agent random cannot use a dataset; choose another agent, or omit the data",
        ),
    ],
)
def test_agents_learn_from_data_where_they_can(
    agent: str, given: dict[str, Any], message: str
) -> None:
    env = Cart()
    config = TrainConfig("Cart", agent, **given)
    learner = make_learner(agent, env)
    assert refused(attach_dataset, config, learner, env) == message


def test_agent_without_data_gets_none() -> None:
    env = Cart()
    assert attach_dataset(CART, make_learner("sac", env), env) is None


def recorded(folder: Path, description: Any, count: int = 4) -> str:
    """A dataset of one episode, which was broken off, and another one."""
    n = len(description.observation)
    m = len(description.action)
    with Recorder(folder, description) as recorder:
        for length in (count - 1, 1):
            steps = [
                Step([float(k)] * n, [0.5] * m, 1.0, [k + 1.0] * n, False, False)
                for k in range(length)
            ]
            recorder.write(steps, About(whole=False))
    return str(folder)


def test_no_step_leads_from_one_recorded_episode_to_the_next(tmp_path: Path) -> None:
    env = Cart()
    data = recorded(tmp_path / "data", describe(env))
    learner: Any = make_learner("sac", env)
    config = dataclasses.replace(CART, demonstrations=data)
    frames = attach_dataset(config, learner, env)
    assert frames is not None
    assert frames["next", "done"].flatten().tolist() == [False, False, True, True]
    assert frames["observation"][:, 0].tolist() == [0.0, 1.0, 2.0, 0.0]
    assert len(learner.dataset) == 4


def test_data_of_another_robot_are_refused(tmp_path: Path) -> None:
    env = Cart()
    own = describe(env)
    (first, *_) = own.observation
    narrow = dataclasses.replace(own, env="Narrow-v0", observation=(first,))
    path = recorded(tmp_path / "narrow", narrow)
    names = ", ".join(entry.name for entry in own.observation)
    assert refused(read_for, path, env, images=False) == (
        f"{path} is of Narrow-v0: its observation is [{first.name}], not [{names}]; choose data of "
        "this environment, or learn in a task of your own that observes what they have"
    )
    (motor,) = own.action
    other = dataclasses.replace(motor, name="sail")
    sailing = dataclasses.replace(own, env="Sail-v0", action=(other,))
    path = recorded(tmp_path / "sail", sailing)
    assert refused(read_for, path, env, images=False) == (
        f"{path} is of Sail-v0: its action is [sail], not [{motor.name}]; choose data of this "
        "environment, or the environment of the data"
    )


def test_run_that_learned_from_data_stands_for_them(tmp_path: Path) -> None:
    env = Cart()
    data = recorded(tmp_path / "data", describe(env))
    config = dataclasses.replace(CART, data=data, updates=40)
    run = run_of(tmp_path / "run", config)
    assert len(read_for(str(run), env, images=False)) == 4
    empty = tmp_path / "empty"
    with Recorder(empty, describe(env)) as recorder:
        recorder.write([], About())
    assert not empty.exists() or "is empty" in refused(read_for, str(empty), env, images=False)


@pytest.mark.parametrize(
    ("changes", "teaches"),
    [
        ({}, True),
        ({"start": "runs/first"}, False),
        ({"agent": "bc", "settings": None}, False),
        ({"demonstrations": None}, False),
    ],
)
def test_policy_of_a_run_teaches_what_begins_anew(
    tmp_path: Path, changes: dict[str, Any], teaches: bool
) -> None:
    run = run_of(tmp_path / "run", CART)
    config = dataclasses.replace(CART, **{"demonstrations": str(run), **changes})
    learner = make_learner(config.agent, Cart())
    teacher = teacher_of(config, learner)
    assert (teacher is not None) is teaches
    if teacher is not None:
        assert teacher.path == run
    folder = dataclasses.replace(CART, demonstrations=str(tmp_path))
    assert teacher_of(folder, learner) is None, "a dataset has no policy"


def test_only_the_same_agent_goes_on(tmp_path: Path) -> None:
    run = run_of(tmp_path / "my run", CART)
    env = Cart()
    learner = make_learner("sac", env)

    def said(**changes: Any) -> str:
        config = dataclasses.replace(CART, start=str(run), **changes)
        return refused(learners.warm_start, config, learner, env, None)

    assert said(agent="td3", settings=None) == (
        f"{run} is sac's, not td3's; take that agent, or let the run demonstrate: "
        f"--demonstrations {learners.quoted(str(run))}"
    )
    assert said(base="scripted") == (f"{run} adds to the base None, not to scripted; give its own")
    other = dataclasses.replace(CART.settings, gamma=0.5)
    usual = CART.settings.gamma
    assert said(settings=other) == (
        f"the agent of {run} has other settings: gamma {usual}, not 0.5; go on with its own"
    )


def test_five_settings_that_differ_are_named() -> None:
    own = dict.fromkeys("abcdefg", 1)
    given = dict.fromkeys("abcdefg", 2)
    assert learners._differing(own, own) == ""
    assert learners._differing({"a": 1, "b": 3}, {"a": 2, "b": 3}) == "a 1, not 2"
    assert learners._differing({"a": 1}, {"b": 2}) == "a 1, not None; b None, not 2"
    five = "; ".join(f"{name} 1, not 2" for name in "abcde")
    assert learners._differing(dict(list(own.items())[:5]), dict(list(given.items())[:5])) == five
    assert learners._differing(own, given) == f"{five} and 2 more"


def test_agent_that_has_diverged_is_told() -> None:
    learner: Any = make_learner("sac", Cart())
    check_weights(learner)
    with torch.no_grad():
        next(iter(learner.policy.parameters())).view(-1)[0] = float("nan")
    with pytest.raises(DivergedError) as raised:
        check_weights(learner)
    assert str(raised.value) == (
        "the agent has diverged: its weights are not finite; train it with a smaller learning_rate"
    )


@pytest.mark.parametrize(
    ("message", "is_told"), [("DefaultCPUAllocator: not enough memory", True), ("bad size", False)]
)
def test_lack_of_memory_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, message: str, is_told: bool
) -> None:
    def fail(*_: Any) -> None:
        raise RuntimeError(message)

    monkeypatch.setattr(learners, "make_learner", fail)
    with pytest.raises(RunError if is_told else RuntimeError) as raised:
        learners.make_learner_for(CART, Cart())
    if is_told:
        assert str(raised.value) == (
            "there is not enough memory for the agent sac; give it smaller networks or memory"
        )


def test_dataset_of_images_needs_what_the_agent_sees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = Cart()
    data = recorded(tmp_path / "data", describe(env))
    config = dataclasses.replace(CART, demonstrations=data)
    specs = dict(learners.given_specs(env))
    wider = specs["observation"].expand(3, 2)
    monkeypatch.setattr(learners, "given_specs", lambda env: {"observation": wider})
    learner = make_learner("sac", env)
    assert refused(attach_dataset, config, learner, env) == (
        "no data hold the 'observation' [3, 2] that Cart observes; learn without data"
    )
    monkeypatch.setattr(learners, "given_specs", lambda env: {"image": wider})
    assert refused(attach_dataset, config, learner, env) == (
        "no data hold what Cart observes; learn without data"
    )
