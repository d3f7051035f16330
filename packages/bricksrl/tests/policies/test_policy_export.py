"""Policies exported without BricksRL."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from bricksrl import make
from bricksrl.agents import preset
from bricksrl.agents.features.observed import SeenInputs
from bricksrl.cli import main
from bricksrl.errors import CheckpointError, RunError
from bricksrl.policies import export, load_policy
from bricksrl.policies.export import export_model
from bricksrl.policies.sharing import export_policy
from bricksrl.training import TrainConfig, train


def run(folder: Path, agent: str, **settings: object) -> Path:
    small = replace(preset("default", agent), **settings)
    return train(
        TrainConfig("RoboArmSim-v0", agent, 1, settings=small, run_dir=folder / agent, record=False)
    ).run_dir


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("runs"), "sac", hidden=(16,))


def test_exported_policy_acts_without_bricksrl(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "arm.pt2"
    assert main(["export", str(trained), "--out", str(out)]) == 0
    assert capsys.readouterr().out.startswith(f"written  {out}  (its actions differ by 0")
    observation = make("RoboArmSim-v0", batch_size=3, seed=1).reset()["observation"]
    torch.save(observation, tmp_path / "observation.pt")
    program = (
        "import sys, torch\n"
        f"observation = torch.load({str(tmp_path / 'observation.pt')!r})\n"
        f"action = torch.export.load({str(out)!r}).module()(observation)\n"
        "assert not {name for name in sys.modules if name.startswith(('bricksrl', 'torchrl', "
        "'tensordict'))}\n"
        f"torch.save(torch.from_numpy(action.numpy()), {str(tmp_path / 'action.pt')!r})\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)
    torch.testing.assert_close(
        torch.load(tmp_path / "action.pt"), load_policy(trained).act(observation)
    )


def test_shared_policy_can_be_exported(trained: Path, tmp_path: Path) -> None:
    assert export_model(export_policy(trained, tmp_path / "shared"), tmp_path / "arm.pt2") < 1e-5
    with pytest.raises(
        RunError, match="shared holds the policy of one checkpoint; take the last one"
    ):
        export_model(tmp_path / "shared", tmp_path / "best.pt2", which="best")


def test_export_says_nothing_of_readings_that_no_robot_made(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = list[str]()
    monkeypatch.setattr(SeenInputs, "_say", lambda *_: said.append("reads"))
    export_model(trained, tmp_path / "arm.pt2")
    assert not said
    load_policy(trained).act(make("RoboArmSim-v0", seed=1).reset()["observation"])
    assert said


def test_numbers_without_a_bound_are_drawn_near_zero() -> None:
    """Else the two policies would be compared at the largest number of a float."""
    env = make("RoboArmSim-v0")
    layout = SimpleNamespace(
        low=(-math.inf, 0.0, -math.inf),
        high=(math.inf, math.inf, 5.0),
        scale=(),
        offset=(),
        vectors={"observation": (3,)},
        images=(),
    )
    drawn = export._observations(env, layout)["observation"]
    assert (drawn.amin(0) >= torch.tensor([-1.0, 0.0, -1.0])).all()
    assert (drawn.amax(0) <= torch.tensor([1.0, 1.0, 5.0])).all()
    assert (drawn.std(0) > 0.1).all()


class Counting:
    """Acts by what it observes, and, where it has a memory, by how often it has acted."""

    def __init__(self, growth: float, *, forgets: bool) -> None:
        self.growth, self.forgets, self.count = growth, forgets, 0

    def reset(self) -> None:
        self.count = 0 if self.forgets else self.count

    def __call__(self, observation: torch.Tensor) -> torch.Tensor:
        self.count += 1
        return observation + self.growth * self.count


@pytest.mark.parametrize(
    ("growth", "forgets", "is_function"),
    [(0.0, False, True), (0.5, True, True), (0.5, False, False)],
)
def test_a_policy_is_exported_if_it_acts_alike_after_it_was_reset(
    growth: float, forgets: bool, is_function: bool
) -> None:
    policy = Counting(growth, forgets=forgets)
    inputs = (torch.arange(6.0).view(3, 2),)
    if is_function:
        best = export._best(policy, policy, inputs)  # type: ignore[arg-type]
        assert torch.equal(best, inputs[0] + growth)
        return
    with pytest.raises(RunError, match="depends on more than what it observes"):
        export._best(policy, policy, inputs)  # type: ignore[arg-type]


def test_existing_file_is_not_overwritten(trained: Path, tmp_path: Path) -> None:
    (tmp_path / "arm.pt2").write_text("mine")
    with pytest.raises(RunError, match="exists already; choose another name"):
        export_model(trained, tmp_path / "arm.pt2")
    assert (tmp_path / "arm.pt2").read_text() == "mine"


def test_wrong_export_is_removed(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        export, "_reader", lambda path, format_: lambda inputs: torch.full((len(inputs[0]), 4), 0.5)
    )
    with pytest.raises(RunError, match="what was written acts otherwise, by"):
        export_model(trained, tmp_path / "arm.pt2")
    assert list(tmp_path.iterdir()) == []


def test_missing_onnx_raises(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        RunError,
        match=r'export as onnx needs onnx and onnxscript; run `pip install "bricksrl\[onnx\]"`',
    ):
        export_model(trained, tmp_path / "arm.onnx", "onnx")
    assert list(tmp_path.iterdir()) == []


def test_onnx_equals_policy(trained: Path, tmp_path: Path) -> None:
    assert export_model(trained, tmp_path / "arm.onnx", "onnx") < 1e-4


def test_random_agent_cannot_be_exported(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="depends on more than what it observes"):
        export_model(run(tmp_path, "random"), tmp_path / "arm.pt2")
    with pytest.raises((RunError, CheckpointError), match="no run|no policy"):
        export_model(tmp_path / "nothing", tmp_path / "arm.pt2")
