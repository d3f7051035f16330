"""Every example runs and is short."""

from __future__ import annotations

import io
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from brickhub.finding import Outcome
from brickhub.virtual import run_file
from bricksrl.agents import preset
from bricksrl.envs.env_checker import check_env
from bricksrl.envs.registry import _BUILT_IN, get_task
from bricksrl.errors import RenderingUnavailableError
from bricksrl.evaluation.evaluator import EvaluationResult, evaluate
from bricksrl.evaluation.film import film_run
from bricksrl.training import RunResult, TrainConfig, train
from bricktwin.twin.make_body import make_body

EXAMPLES = Path(__file__).parents[2] / "examples"
DRIVING_LINES = 50  # the whole file of a driving robot with its task, its body and its floor
LONG = {"16_sequences": 120}
TINY = replace(
    preset("default", "sac"), hidden=(8,), batch_size=8, prefill_episodes=1, updates_per_step=0.1
)
"""Settings of runs that are not to learn anything."""
SHORT_STEPS = 10
"""Steps of their episodes, where an example has more."""
OWN_LINES = 40  # what issue and README promise for a task or a robot of one's own


def lines_of_code(path: Path) -> int:
    """Lines without module docstring and blank ones."""
    code = path.read_text(encoding="utf-8").split('"""', 2)[2]
    return sum(bool(line.strip()) for line in code.splitlines())


def shortened(path: Path, folder: Path) -> Path:
    """A copy of an example, and of its plan, with short episodes."""
    code, changes = re.subn(
        r"max_steps=\d+", f"max_steps={SHORT_STEPS}", path.read_text(encoding="utf-8")
    )
    assert changes == 1
    copy = folder / path.name
    copy.write_text(code, encoding="utf-8")
    for plan in EXAMPLES.glob(f"{path.stem}.ldr"):
        shutil.copy(plan, folder)
    return copy


@pytest.fixture
def main(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """``main`` of an example, run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda name: runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="example")["main"]


@pytest.fixture
def in_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Examples train a tiny network in short episodes, and evaluate it in one."""

    def trained(config: TrainConfig) -> RunResult:
        has_steps = config.env.startswith("Walker")
        short = {"max_steps": SHORT_STEPS} if has_steps else {}
        return train(replace(config, settings=TINY, options=short))

    def evaluated(*arguments: Any, episodes: int, **named: Any) -> EvaluationResult:
        assert episodes > 1
        return evaluate(*arguments, episodes=1, **named)

    monkeypatch.setattr("bricksrl.training.train", trained)
    monkeypatch.setattr("bricksrl.evaluation.evaluate", evaluated)


def test_examples_are_short() -> None:
    paths = sorted(EXAMPLES.glob("*.py"))
    assert [path.name[:3] for path in paths] == [
        f"{number:02}_" for number in range(1, len(paths) + 1)
    ]
    assert all(
        len(path.read_text(encoding="utf-8").splitlines()) <= LONG.get(path.stem, 60)
        for path in paths
    )


def test_first_run(main, capsys) -> None:
    main("01_first_run")()
    assert "return: 1" in capsys.readouterr().out


def test_train(in_short, main, capsys) -> None:
    main("02_train")(episodes=2)
    assert "on other robots" in capsys.readouterr().out


@pytest.mark.parametrize(
    "name", ["03_own_task", "04_own_robot", "13_front_steered", "14_driving_robot", "15_six_legs"]
)
def test_own_robot_and_task(name: str, tmp_path: Path) -> None:
    path = EXAMPLES / f"{name}.py"
    assert lines_of_code(path) <= OWN_LINES
    assert [check for check in check_env(f"{path}") if check.outcome is Outcome.ERROR] == []
    short = shortened(path, tmp_path)
    result = train(TrainConfig(str(short), episodes=2, settings=TINY, run_dir=tmp_path / "run"))
    assert [episode.length <= SHORT_STEPS for episode in result.episodes] == [True, True]


def test_own_driving_robot_video(tmp_path: Path) -> None:
    path, run_dir = EXAMPLES / "14_driving_robot.py", tmp_path / "run"
    assert len(path.read_text(encoding="utf-8").splitlines()) <= DRIVING_LINES
    train(TrainConfig(str(path), episodes=1, settings=TINY, run_dir=run_dir))
    try:
        filmed = film_run(
            run_dir, "last", tmp_path / "film.mp4", "it drives", size=(320, 240), budget_s=1.0
        )
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert filmed.path.stat().st_size > 5_000


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["03_own_task", "04_own_robot", "13_front_steered", "14_driving_robot", "15_six_legs"]
)
def test_own_tasks_are_learned(name: str, tmp_path: Path) -> None:
    episodes = train(
        TrainConfig(str(EXAMPLES / f"{name}.py"), episodes=30, run_dir=tmp_path / "run")
    ).episodes
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


def test_evaluate_elsewhere(in_short, main, capsys) -> None:
    main("08_evaluate_elsewhere")(episodes=1)
    assert "Walker-v0: return" in capsys.readouterr().out


def test_camera(main, capsys, monkeypatch) -> None:
    monkeypatch.setattr("bricksrl.envs.registry._specs", dict(_BUILT_IN))
    # where it is there, weights would be fetched
    monkeypatch.setitem(sys.modules, "torchvision", None)
    main("09_camera")()
    said = capsys.readouterr().out
    assert "on the robot: torch.uint8 [64, 64, 3]" in said
    assert "stacked: [6, 6, 64, 64]" in said
    assert "encoded: no, r3m needs a torchvision" in said


def test_hub_program() -> None:
    out, task = io.BytesIO(), get_task("RunAway-v0")
    code = run_file(
        EXAMPLES / "10_hub_program.py",
        make_body(task.robot, scene=task.scene),
        stdout=out,
        stderr=sys.stderr,
    )
    before, after = (
        int(line.split("is ")[1].split(" ")[0]) for line in out.getvalue().decode().splitlines()
    )
    assert code == 0 and before < 500 <= 800 <= after


def test_program_test_imports_no_torch() -> None:
    test = f"""
import pytest, sys
passed = pytest.main([{str(EXAMPLES / "11_test_a_program.py")!r}, "--quiet", "-p", "no:cacheprovider"]) == 0
print(passed, sorted({{"gymnasium", "mujoco", "numpy", "tensordict", "torch", "torchrl"}} & set(sys.modules)))
"""  # noqa: E501
    done = subprocess.run(
        [sys.executable, "-c", test], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.splitlines()[-1] == "True []", done.stdout
