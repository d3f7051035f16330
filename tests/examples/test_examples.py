"""Every example runs, is one screen, and says something sensible."""

from __future__ import annotations

import io
import runpy
import sys
from pathlib import Path

import pytest

from bricksrl.envs.check import Outcome, check_env
from bricksrl.envs.registry import _OWN, get_task
from bricksrl.training import TrainConfig, train
from bricksrl.twin.run import run_file

EXAMPLES = Path(__file__).parents[2] / "examples"
OWN_LINES = 40  # what issue and README promise for a task or a robot of one's own


def lines_of_code(path: Path) -> int:
    """Lines without those of the first docstring and without empty ones."""
    code = path.read_text(encoding="utf-8").split('"""', 2)[2]
    return sum(bool(line.strip()) for line in code.splitlines())


@pytest.fixture
def main(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """``main`` of an example, run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda name: runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="example")["main"]


def test_each_is_one_screen() -> None:
    paths = sorted(EXAMPLES.glob("*.py"))
    assert [path.name[:3] for path in paths] == [f"{number:02}_" for number in range(1, len(paths) + 1)]
    assert all(len(path.read_text(encoding="utf-8").splitlines()) <= 50 for path in paths)


def test_first_run(main, capsys) -> None:
    main("01_first_run")()
    assert "return: 1" in capsys.readouterr().out


def test_train(main, capsys) -> None:
    main("02_train")(episodes=2)
    assert "on other robots" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["03_own_task", "04_own_robot"])
def test_own(name: str, tmp_path: Path) -> None:
    path = EXAMPLES / f"{name}.py"
    assert lines_of_code(path) <= OWN_LINES
    assert [check for check in check_env(f"{path}") if check.outcome is Outcome.FAILED] == []
    result = train(TrainConfig(str(path), episodes=3, run_dir=tmp_path / "run"))
    assert len(result.episodes) == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["03_own_task", "04_own_robot"])
def test_own_tasks_are_learned(name: str, tmp_path: Path) -> None:
    episodes = train(TrainConfig(str(EXAMPLES / f"{name}.py"), episodes=30, run_dir=tmp_path / "run")).episodes
    returns = [episode.return_ for episode in episodes]
    assert sum(returns[-5:]) / 5 > sum(returns[:10]) / 10 + 1.0


def test_transforms(main, capsys) -> None:
    main("05_transforms")()
    assert "frames: [25, 18]" in capsys.readouterr().out


def test_gymnasium(main, capsys) -> None:
    main("06_gymnasium")()
    assert "'success': True" in capsys.readouterr().out


def test_batched_simulation(main, capsys) -> None:
    main("07_batched_simulation")(batch_size=200, steps=20)
    assert "steps to a goal" in capsys.readouterr().out


def test_evaluate_elsewhere(main, capsys) -> None:
    main("08_evaluate_elsewhere")(episodes=1)
    assert "Walker-v0: return" in capsys.readouterr().out


def test_camera(main, capsys, monkeypatch) -> None:
    monkeypatch.setattr("bricksrl.envs.registry._offers", dict(_OWN))
    monkeypatch.setitem(sys.modules, "torchvision", None)  # where it is there, weights would be fetched
    main("09_camera")()
    said = capsys.readouterr().out
    assert "on the robot: torch.uint8 [64, 64, 3]" in said
    assert "stacked: [6, 6, 64, 64]" in said
    assert "encoded: no, r3m needs torchvision" in said


def test_hub_program() -> None:
    out, task = io.BytesIO(), get_task("RunAway-v0")
    code = run_file(EXAMPLES / "10_hub_program.py", task.robot, scene=task.scene, stdout=out, stderr=sys.stderr)
    before, after = (int(line.split("is ")[1].split(" ")[0]) for line in out.getvalue().decode().splitlines())
    assert code == 0 and before < 500 <= 800 <= after
