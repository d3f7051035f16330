"""Tasks from users' files and modules."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import bricksrl
from brickhub.user_files import with_absolute_file
from bricksrl.cli import main
from bricksrl.errors import DescriptionError, UnknownNameError
from bricksrl.evaluation import evaluate
from bricksrl.interfaces.gymnasium import GymnasiumEnv
from bricksrl.target import find
from bricksrl.training import RunFolder

FILE = """
from dataclasses import replace
from beside import STEPS
from bricksrl.envs.tasks.run_away import RUN_AWAY
MINE = replace(RUN_AWAY, id="Mine-v0", max_steps=STEPS)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "beside.py").write_text("STEPS = 3\n")
    (tmp_path / "mine.py").write_text(FILE)
    one = "from dataclasses import replace\nimport bricksrl.envs.tasks.run_away as r\n"
    (tmp_path / "single.py").write_text(one + "MINE = SAME = replace(r.RUN_AWAY, id='One-v0')\n")
    (tmp_path / "options.py").write_text(
        one + "def task(steps=5):\n    return replace(r.RUN_AWAY, id='O-v0', max_steps=steps)\n"
    )
    (tmp_path / "broken.py").write_text("import no_such_module\n")
    (tmp_path / "raises.py").write_text("1 / 0\n")
    (tmp_path / "other.py").write_text("TASK = 3\ndef task():\n    return 3\n")
    yield tmp_path
    for name in ("beside", "mine", "single", "options"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("reference", ["mine.py:MINE", "./mine.py:MINE", "mine:MINE"])
def test_task_from_file_or_module(folder: Path, reference: str) -> None:
    path = list(sys.path)
    assert bricksrl.envs.get_task(reference).max_steps == 3
    assert sys.path == path
    env = bricksrl.make(reference, seed=0)
    assert env.rollout(9).shape == (3,)
    env.close()
    assert str(folder) not in sys.path  # TorchRL's imports may have added others


def test_absolute_reference_outlives_the_folder_it_was_given_in(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    reference = with_absolute_file("../mine.py:MINE")
    monkeypatch.chdir(folder)
    (folder / "elsewhere").rmdir()
    assert bricksrl.envs.get_task(reference).max_steps == 3


def test_name_is_optional_for_single_task(folder: Path) -> None:
    assert bricksrl.envs.get_task("single.py").id == "One-v0"
    with pytest.raises(UnknownNameError, match="2 tasks .*RUN_AWAY, MINE"):
        bricksrl.envs.get_task("mine.py")


def test_task_function_with_options(folder: Path) -> None:
    assert bricksrl.envs.get_task("options.py:task").max_steps == 5
    assert bricksrl.envs.get_task("options.py:task", steps=2).max_steps == 2
    with pytest.raises(DescriptionError, match="no option colour"):
        bricksrl.envs.get_task("options.py:task", colour=2)


def test_option_of_a_users_file_is_one_everywhere(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The parameter of the user's function is an option of Python, of Gymnasium, and of the
    commands and what they store."""
    env = bricksrl.make("options.py:task", steps=2, seed=0)
    assert env.rollout(9).shape == (2,)
    env.close()
    gymnasium = GymnasiumEnv("options.py:task", steps=2)
    gymnasium.reset(seed=0)
    assert [gymnasium.step(gymnasium.action_space.sample())[3] for _ in range(2)] == [False, True]
    gymnasium.close()
    words = (
        "options.py:task",
        "--option",
        "steps=2",
        "--agent",
        "random",
        "--episodes",
        "1",
        "--no-film",
        "--run",
        "run",
    )
    assert main(["train", *words]) == 0
    assert [episode.length for episode in RunFolder("run").read_episodes()] == [2]
    assert evaluate("run", episodes=1).lengths == (2,)
    assert evaluate("run", episodes=1, steps=3).lengths == (3,)
    assert (
        main(
            ["record", "options.py:task", "--option", "steps=2", "--episodes", "1", "--out", "data"]
        )
        == 0
    )
    assert "  2 steps" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("reference", "error", "says"),
    [
        (
            "nowhere.py:TASK",
            UnknownNameError,
            "no file nowhere.py in .*, or go to the right folder",
        ),
        ("/nowhere.py:TASK", UnknownNameError, "no file /nowhere.py; put it there"),
        ("nowhere:TASK", UnknownNameError, "no module 'nowhere'"),
        ("mine.py:YOURS", UnknownNameError, "no 'YOURS' in mine.py"),
        ("broken.py:TASK", DescriptionError, r"no_such_module.*, broken\.py, line \d+\)"),
        ("broken:TASK", DescriptionError, "no_such_module"),
        ("raises.py", DescriptionError, "division by zero"),
        ("other.py:TASK", DescriptionError, "no task"),
        ("other.py:task", DescriptionError, "returns a int"),
        (
            "other.py",
            UnknownNameError,
            "other.py has no task; `bricksrl new task FILE` writes a file with one",
        ),
        (":TASK", UnknownNameError, "module"),
    ],
)
def test_invalid_task_reference_raises(
    folder: Path, reference: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says) as caught:
        bricksrl.make(reference)
    assert "\n" not in str(caught.value)


def test_robot_that_is_not_in_the_file_is_named_so(folder: Path) -> None:
    with pytest.raises(
        UnknownNameError, match=r"no 'ROBOT' in mine\.py; name a robot that is written there"
    ):
        find("mine.py:ROBOT")
