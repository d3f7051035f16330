"""User algorithms with other TorchRL losses: train, resume, evaluate, tune."""

from __future__ import annotations

import json
from pathlib import Path

import optuna
import pytest
import torch
from test_training_loop import Recorder, assert_same_run, ctrl_c
from toys import Cart

import bricksrl
from bricksrl.agents import algorithm, preset
from bricksrl.cli import main
from bricksrl.errors import CheckpointError, DescriptionError, UnknownNameError
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.tuning import BEST, Tuning, propose, tune
from bricksrl.policies import load_policy
from bricksrl.training import RunFolder, TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint

SEQUENCES = str(Path(__file__).parents[4] / "examples" / "16_sequences.py")
EXAMPLE = Path(__file__).parents[4] / "examples" / "12_own_agent.py"

REDQ = '''
from dataclasses import dataclass

import torch
from tensordict.nn import TensorDictModule
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.modules import NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import REDQLoss, SoftUpdate

from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.replay.replay_learner import ReplayLearner


@dataclass(frozen=True)
class Redq:
    rate: float = 1e-3
    """Step size."""
    hidden: tuple[int, ...] = (16,)
    """Units."""


class Both(torch.nn.Sequential):
    def forward(self, *inputs):
        return super().forward(torch.cat(inputs, -1))


def make_redq(env, settings: Redq, device="cpu"):
    n, m = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    units = settings.hidden[0]
    body = torch.nn.Sequential(torch.nn.Linear(n, units), torch.nn.ReLU(), torch.nn.Linear(units, 2 * m), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictModule(body, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
    )
    critic = Both(torch.nn.Linear(n + m, units), torch.nn.ReLU(), torch.nn.Linear(units, 1))
    loss = REDQLoss(actor, ValueOperator(critic, in_keys=["observation", "action"]), num_qvalue_nets=3, target_entropy=-float(m))
    loss.make_value_estimator(gamma=0.9)
    optimizer = torch.optim.Adam(loss.parameters(), lr=settings.rate)
    return ReplayLearner(
        actor,
        GradientDescent(loss, optimizer, SoftUpdate(loss, tau=0.01)),
        TensorDictReplayBuffer(storage=LazyTensorStorage(40), batch_size=8),
        prefill_episodes=1,
    )
'''  # noqa: E501


@pytest.fixture
def redq(tmp_path: Path) -> str:
    (tmp_path / "own.py").write_text(REDQ)
    return f"{tmp_path / 'own.py'}:make_redq"


def test_user_loss_trains_and_resumes_exactly(redq: str, tmp_path: Path) -> None:
    """Its buffer is TorchRL's, and has wrapped."""
    config = TrainConfig("Cart", redq, 8, seed=3, run_dir=tmp_path / "whole")
    result = train(config, env=Cart())
    assert {"loss_actor", "loss_qvalue", "loss_alpha"} <= set(result.episodes[-1].measures)
    assert result.episodes[-1].steps > 40
    part = TrainConfig("Cart", redq, 8, seed=3, run_dir=tmp_path / "run")
    assert train(part, Recorder((7, 2), ctrl_c), env=Cart()).interrupted
    resume(tmp_path / "run", env=Cart())
    assert_same_run(tmp_path / "whole", tmp_path / "run")
    assert RunFolder(tmp_path / "run").read_config().agent == redq
    assert evaluate(tmp_path / "run", Cart(), episodes=2).agent == redq


def test_user_algorithm_starts_from_its_earlier_run(redq: str, tmp_path: Path) -> None:
    train(TrainConfig("Cart", redq, 3, run_dir=tmp_path / "first"), env=Cart())
    train(
        TrainConfig("Cart", redq, 2, start=str(tmp_path / "first"), run_dir=tmp_path / "second"),
        env=Cart(),
    )
    first, second = (
        load_checkpoint(tmp_path / name / "checkpoint.bin")["agent"]["updates"]
        for name in ("first", "second")
    )
    assert 0 < first < second


def test_dataset_beside_the_users_buffer(redq: str, tmp_path: Path) -> None:
    """Half of each batch with ours, whatever the settings are."""
    train(TrainConfig("Cart", redq, episodes=2, run_dir=tmp_path / "first"), env=Cart())
    named = {
        "start": str(tmp_path / "first"),
        "demonstrations": str(tmp_path / "first"),
        "run_dir": tmp_path / "second",
    }
    buffer = "TransitionReplayBuffer(40, 8, ['observation'])"
    text = REDQ.replace(
        "TensorDictReplayBuffer(storage=LazyTensorStorage(40), batch_size=8)", buffer
    )
    (tmp_path / "own.py").write_text(
        f"from bricksrl.agents.replay.buffer import TransitionReplayBuffer\n{text}"
    )
    result = train(TrainConfig("Cart", redq, episodes=2, **named), env=Cart())
    assert result.episodes[-1].measures


def test_sequences_are_learned_from_a_dataset_and_then_online(tmp_path: Path) -> None:
    """What was recorded comes first in the user's own buffer, whose batches are slices of
    episodes."""
    data, offline, online = (str(tmp_path / name) for name in ("data", "offline", "online"))
    train(TrainConfig("WalkerSim-v0", "random", 2, seed=0, run_dir=Path(data)))
    train(TrainConfig("WalkerSim-v0", SEQUENCES, 1, data=data, updates=20, run_dir=Path(offline)))
    result = train(TrainConfig("WalkerSim-v0", SEQUENCES, 1, start=offline, run_dir=Path(online)))
    assert 0.0 < result.episodes[-1].measures["loss_action"] < 1.0
    agents = [load_checkpoint(Path(run) / "checkpoint.bin")["agent"] for run in (offline, online)]
    assert [len(agent["memory"]["rows"]["action"]) for agent in agents] == [200, 300]
    assert [agent["updates"] for agent in agents] == [20, 120]


@pytest.mark.usefixtures("forked_children")
def test_asynchronous_user_algorithm(redq: str, tmp_path: Path) -> None:
    result = train(
        TrainConfig("Cart", redq, 8, run_dir=tmp_path / "run", asynchronous=True), env=Cart()
    )
    assert any(episode.measures.get("loss_qvalue", 0.0) > 0 for episode in result.episodes)
    assert load_checkpoint(tmp_path / "run" / "checkpoint.bin")["agent"]["updates"] > 0


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("Linear(n, units)", "Linear(n + 1, units)", "mat1 and mat2"),
        ("Linear(units, 1)", "Linear(units, 2)", "size of tensor"),
        (", batch_size=8", "", "batch_size not specified"),
        (
            "distribution_class=TanhNormal",
            "out_keys=['act'], distribution_class=TanhNormal",
            'key "action" not found',
        ),
    ],
)
def test_failure_of_a_users_algorithm_is_told(
    redq: str, tmp_path: Path, old: str, new: str, problem: str
) -> None:
    (tmp_path / "own.py").write_text(REDQ.replace(old, new))
    with pytest.raises(DescriptionError, match=f"own.py:make_redq fails .*{problem}"):
        train(TrainConfig("Cart", redq, 2, run_dir=tmp_path / "run"), env=Cart())


@pytest.mark.slow
def test_example_agent_learns_tunes_and_shares(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, agent = tmp_path / "run", str(EXAMPLE)
    options = (
        "--set",
        "noise=0.2",
        "--set",
        "hidden=32,32",
        "--set",
        "batch_size=32",
        "--episodes",
        "6",
        "--run",
        str(run),
    )
    assert main(["train", "RoboArmSim-v0", "--agent", agent, *options]) == 0
    assert RunFolder(run).read_config().settings.noise == 0.2
    assert main(["resume", str(run), "--episodes", "8"]) == 0
    assert main(["evaluate", str(run), "--episodes", "2", "--json"]) == 0
    assert main(["settings", agent, "--json"]) == 0
    written = capsys.readouterr().out
    assert json.loads(written[written.rindex("{\n") :])["noise"] == 0.3
    env = bricksrl.make("RoboArmSim-v0", seed=0)
    policy = bricksrl.load_policy(run)
    assert len(env.rollout(5, policy)) <= 5
    with pytest.raises(CheckpointError, match="learned in RoboArmSim-v0; choose an environment"):
        bricksrl.load_policy(run, bricksrl.make("WalkerSim-v0"))
    best = tune(
        Tuning("RoboArmSim-v0", agent, steps=20, seeds=1, episodes=1),
        tmp_path / "attach_dataset",
        2,
    )
    assert best.trials == 2 and 0.03 <= best.settings.noise <= 3.0
    assert (
        json.loads((tmp_path / "attach_dataset" / BEST).read_text())["settings"]["noise"]
        == best.settings.noise
    )


@pytest.mark.slow
def test_example_agent_reaches_goals(tmp_path: Path) -> None:
    train(TrainConfig("RoboArmSim-v0", str(EXAMPLE), episodes=60, run_dir=tmp_path / "run"))
    assert evaluate(tmp_path / "run", episodes=20).success_rate >= 0.8


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("1 / 0", DescriptionError, "cannot be loaded .*ZeroDivisionError"),
        ("", UnknownNameError, "there is no 'build'"),
        ("import sys; sys.exit(3)", DescriptionError, "cannot be loaded .*SystemExit: 3"),
        ("def build(env, device): pass", DescriptionError, "takes no settings; write build"),
        (
            "def build(env, settings, device): pass",
            DescriptionError,
            "has no type for its settings",
        ),
    ],
)
def test_invalid_algorithm_raises(
    tmp_path: Path, text: str, error: type[Exception], says: str
) -> None:
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(error, match=says) as caught:
        algorithm(str(tmp_path / "own.py"))
    assert "\n" not in str(caught.value)


def test_user_settings_have_default_preset_only(redq: str) -> None:
    assert preset("default", redq).rate == 1e-3
    with pytest.raises(UnknownNameError, match="has no preset 'paper'"):
        preset("paper", redq)


def test_user_policy_keys(tmp_path: Path) -> None:
    train(TrainConfig("RoboArmSim-v0", episodes=1, run_dir=tmp_path / "run", record=False))
    for path in (tmp_path / "run", str(tmp_path / "run")):
        policy = load_policy(path)
        one = policy.act(torch.full((8,), 3.0))
        many = policy.act(torch.full((5, 8), 3.0).numpy())
        assert isinstance(one, torch.Tensor) and one.shape == (4,) and many.shape == (5, 4)
        assert type(many).__module__ == "numpy" and many.dtype.name == "float32"
        torch.testing.assert_close(torch.from_numpy(many[2]), one)
        copies = bricksrl.make("RoboArmSim-v0", batch_size=3, seed=1)
        assert copies.rollout(4, policy, break_when_any_done=False)["action"].shape == (3, 4, 4)


NO_DEFAULT = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Mine:
    rate: float

def build(env, settings: Mine, device): ...
"""


def test_users_settings_need_defaults(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(NO_DEFAULT)
    with pytest.raises(DescriptionError, match="have no default for rate; give it one"):
        preset("default", str(tmp_path / "own.py"))


LIMITED = """
from dataclasses import dataclass
from bricksrl.agents import ppo


@dataclass(frozen=True)
class Settings(ppo.PPOSettings):
    offset: float = -2.0

def build(env, settings: Settings, device="cpu"):
    return ppo.build(env, settings, device)
"""


def test_tuning_stays_within_ranges_of_the_users_settings(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(LIMITED)
    start = preset("default", str(tmp_path / "own.py"))
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=1))
    for _ in range(20):
        proposed = propose(study.ask(), start, goals=False)
        assert 0.095 <= proposed.gae_lambda <= 1.0
        assert -20.0 <= proposed.offset <= -0.2
