"""Algorithms and networks from users' files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from small import ENV, make, settings, steps, taught, weights
from torch import nn

from bricksrl.agents import algorithm, is_reference, make_learner, preset
from bricksrl.errors import BricksError, DescriptionError, UnknownNameError

DDPG = """
from dataclasses import dataclass
from typing import Annotated

import torch
from torchrl.objectives import DDPGLoss, SoftUpdate

from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.networks import action_size, action_spec, deterministic_policy, make_body
from bricksrl.agents.operators import critic_operator
from bricksrl.agents.replay.buffer import make_replay_buffer
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.agents.settings import OffPolicySettings, Range


@dataclass(frozen=True)
class DDPGSettings(OffPolicySettings):
    tau: Annotated[float, Range(0.0, 1.0, above=True)] = 0.01


def build(env, settings: DDPGSettings, device="cpu"):
    m, encoder = action_size(env), make_encoder(env, settings)
    actor, policy = deterministic_policy(encoder, make_body(settings, encoder.size, m), action_spec(env), noise=0.2)
    critic = critic_operator(encoder, make_body(settings, encoder.size + m, 1))
    loss = DDPGLoss(actor, critic, delay_actor=True, delay_value=True)
    loss.make_value_estimator(gamma=settings.gamma)
    optimizer = torch.optim.Adam(loss.parameters(), lr=settings.learning_rate)
    memory = make_replay_buffer(env, settings, device)
    descent = GradientDescent(loss, optimizer, SoftUpdate(loss, tau=settings.tau))
    return ReplayLearner(policy, descent, memory, updates_per_step=2.0)


other = build
"""  # noqa: E501


@pytest.fixture
def ddpg(tmp_path: Path) -> str:
    path = tmp_path / "my_agent.py"
    path.write_text(DDPG)
    return str(path)


def test_user_algorithm_with_torchrl_loss_learns(ddpg: str) -> None:
    kind = algorithm(ddpg).settings
    assert (kind.__name__, kind().tau, kind().gamma) == ("DDPGSettings", 0.01, 0.95)
    assert vars(preset("default", ddpg)) == vars(kind())
    learner = make_learner(ddpg, ENV, kind(hidden=(16, 16), batch_size=10))
    before = weights(learner)
    taught(learner)
    assert not all(
        torch.equal(one, other) for one, other in zip(before, weights(learner), strict=False)
    )
    assert tuple(learner.loss.out_keys)[:2] == ("loss_actor", "loss_value")
    assert learner.explore(steps(3))["action"].shape == (3, 4)
    assert make_learner(f"{ddpg}:other", ENV).updates_per_step == 2.0
    other = make_learner(ddpg, ENV, kind(hidden=(16, 16), batch_size=10))
    other.load_state_dict(learner.state_dict())
    assert torch.equal(other.exploit(steps(3))["action"], learner.exploit(steps(3))["action"])


def test_user_algorithm_settings_are_checked(ddpg: str) -> None:
    with pytest.raises(DescriptionError, match="tau is 0; give a number above 0 to 1"):
        algorithm(ddpg).settings(tau=0)
    with pytest.raises(DescriptionError, match="DDPGSettings, not SACSettings"):
        make_learner(ddpg, ENV, preset("default", "sac"))
    with pytest.raises(UnknownNameError, match=r"has no preset 'paper'; it has its own defaults"):
        preset("paper", ddpg)


START = "from dataclasses import dataclass\n\n@dataclass(frozen=True)\nclass S:\n    a: int = 1\n\n"


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        ("x = 1\n", UnknownNameError, "there is no 'build'"),
        ("def build(\n", DescriptionError, "cannot be loaded"),
        (
            "raise RuntimeError('no luck')\n",
            DescriptionError,
            r"cannot be loaded \(RuntimeError: no luck.*line 1",
        ),
        ("import no_such_module\n", DescriptionError, "cannot be loaded"),
        ("build = 3\n", DescriptionError, "takes no settings; write build"),
        ("def build(env): pass\n", DescriptionError, "takes no settings; write build"),
        (
            "def build(env, settings, device): pass\n",
            DescriptionError,
            "has no type for its settings",
        ),
        (
            "def build(env, settings: int, device): pass\n",
            DescriptionError,
            "has no type for its settings",
        ),
        (
            "def build(env, settings: 'Gone', device): pass\n",
            DescriptionError,
            "has no type for its settings",
        ),
        (
            "from bricksrl.agents.settings import TargetSettings as T\ndef build(settings: T): 1",
            DescriptionError,
            r"are TargetSettings alone, which are a part; .*\(TargetSettings, OffPolicySettings\)",
        ),
        (
            START + "def build(env, settings: S, device): return 3\n",
            DescriptionError,
            "builds a int; let it return",
        ),
        (
            START + "def build(env, settings: S, device): return 1 / 0\n",
            DescriptionError,
            r"cannot be built \(ZeroDivisionError: ",
        ),
        (
            START + "def build(env, settings: S): return 3\n",
            DescriptionError,
            r"cannot be built \(TypeError: ",
        ),
        (
            "from __future__ import annotations\n"
            + START
            + "def build(env, settings: S, device): raise ValueError\n",
            DescriptionError,
            r"cannot be built \(ValueError",
        ),
    ],
)
def test_invalid_agent_file_raises(
    tmp_path: Path, text: str, kind: type[BricksError], says: str
) -> None:
    path = tmp_path / "wrong.py"
    path.write_text(text)
    with pytest.raises(kind, match=says) as caught:
        make_learner(str(path), ENV)
    assert "wrong.py" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_agent_file_raises() -> None:
    with pytest.raises(UnknownNameError, match="there is no file nowhere.py"):
        make_learner("nowhere.py:build", ENV)


def test_own_errors_pass_through(tmp_path: Path) -> None:
    path = tmp_path / "strict.py"
    path.write_text(
        START
        + (
            "from bricksrl.errors import DescriptionError\n"
            "def build(env, settings: S, device): raise DescriptionError('so')\n"
        )
    )
    with pytest.raises(DescriptionError, match="^so$"):
        make_learner(str(path), ENV)


def test_references_differ_from_names() -> None:
    assert [
        is_reference(name) for name in ("sac", "my.py", "my.py:NAME", "package.module:NAME")
    ] == [False, True, True, True]


NETWORK = """
from torch import nn

def make(in_size, out_size):
    return nn.Sequential(nn.Linear(in_size, 7), nn.SiLU(), nn.Linear(7, out_size))

make_network = make

def broken(in_size, out_size):
    return nn.Linear(in_size, out_size + 1)[0]

def no_module(in_size, out_size):
    return 3
"""


@pytest.mark.parametrize("agent", ["sac", "td3", "ppo", "iql", "bc", "diffusion"])
def test_user_network_factory_learns(tmp_path: Path, agent: str) -> None:
    path = tmp_path / "my_nets.py"
    path.write_text(NETWORK)
    learner = make(agent, network=f"{path}:make")
    assert any(isinstance(module, nn.SiLU) for module in learner.policy.modules())
    before = weights(learner)
    taught(learner)
    assert not all(
        torch.equal(one, other) for one, other in zip(before, weights(learner), strict=False)
    )
    assert learner.exploit(steps(3))["action"].shape == (3, 4)
    assert make(agent, network=str(path)).policy is not None


@pytest.mark.parametrize(
    ("network", "says"),
    [
        ("nowhere.py", "there is no file nowhere.py"),
        ("json", "there is no network 'json'; give FILE.py:NAME"),
        ("my_nets.py:gone", "there is no 'gone'"),
        ("my_nets.py:broken", r"my_nets.py:broken makes no network \(TypeError: "),
        ("my_nets.py:no_module", "makes a int; let it return a torch.nn.Module"),
    ],
)
def test_invalid_network_factory_raises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, network: str, says: str
) -> None:
    (tmp_path / "my_nets.py").write_text(NETWORK)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BricksError, match=says) as caught:
        make_learner("sac", ENV, replace(settings("sac"), network=network))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("nn.Linear(i, 5)", r"makes a network from \[2, 14\] to \[2, 5\]; let it give \[2, 8\]"),
        ("nn.Linear(i, o).double()", "fails on .* \\(RuntimeError: .*dtype"),
        ("nn.Linear(i, o).requires_grad_(False)", "td3 cannot be built .*empty parameter list"),
    ],
)
def test_unsuitable_network_raises(tmp_path: Path, code: str, says: str) -> None:
    path = tmp_path / "nets.py"
    path.write_text(f"from torch import nn\ndef make_network(i, o): return {code}\n")
    with pytest.raises(DescriptionError, match=says):
        make("td3" if "td3" in says else "sac", network=str(path))


def test_network_that_needs_a_batch_raises(tmp_path: Path) -> None:
    path = tmp_path / "batch.py"
    path.write_text(
        "from torch import nn\ndef make_network(m, n):\n"
        "    return nn.Sequential(nn.BatchNorm1d(m), nn.Linear(m, n))\n"
    )
    with pytest.raises(
        DescriptionError,
        match=r"fails on \[\d+\] \(ValueError: .*\); a policy acts on one .* with LayerNorm",
    ):
        make("sac", network=str(path))


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_batch_normalisation_acts_by_running_statistics(agent: str, tmp_path: Path) -> None:
    path = tmp_path / "normalised.py"
    lines = [
        "from torch import nn",
        "from bricksrl.agents.crossq import BatchNorm",
        "def make_network(m, n):",
    ]
    path.write_text(
        "\n".join([*lines, "    return nn.Sequential(BatchNorm(m), nn.Linear(m, n))", ""])
    )
    learner = make(agent, network=str(path))
    frame = ENV.reset()
    before = {name: value.clone() for name, value in learner.policy.state_dict().items()}
    learner.explore(frame.clone())
    action = learner.exploit(frame.clone())["action"]
    assert action.isfinite().all() and all(
        torch.equal(before[name], value) for name, value in learner.policy.state_dict().items()
    )
