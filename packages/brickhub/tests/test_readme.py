"""The README and its page: their commands, program, test, workflow and link do what they say."""

from __future__ import annotations

import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from readme import Readme, needs_a_hub

from brickhub.cli import main
from brickhub.cli.app import parse
from brickhub.cli.command_table import LINE

FOLDER = Path(__file__).parents[1]
README = Readme(FOLDER / "README.md", "brickhub")
PAGE = Readme(FOLDER.parents[1] / "docs" / "brickhub.md", "brickhub")


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of somebody who has copied all files of the README."""
    monkeypatch.chdir(tmp_path)
    assert README.write_files(tmp_path) == ["main.py", "floor.csv", "test_main.py"]
    (tmp_path / "my_robot.py").write_text(link())
    return tmp_path


def cheap(words: list[str]) -> list[str]:
    """The command in simulated time, with an end."""
    limit = ["--time-limit-s", "5"] if words[0] == "run" and "--time-limit-s" not in words else []
    return [word for word in words if word != "--realtime"] + limit


def link() -> str:
    first, _ = PAGE.blocks("python")
    return first


def test_what_is_shown_is_printed(reader: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert README.consoles
    for words, output in README.consoles:
        assert (main(words), capfd.readouterr().out) == (0, output)


def test_commands_run(reader: Path, capfd: pytest.CaptureFixture[str]) -> None:
    done = [words for words in README.commands + PAGE.commands if not needs_a_hub(words)]
    assert len(done) >= 4
    for words in done:
        code = main(cheap(words))
        out, err = capfd.readouterr()
        # A described robot has no more than its devices: the program's are on other ports.
        assert code == (1 if "my_robot.py" in words and words[0] == "run" else 0), (words, err)
        assert out or code, words
    assert (reader / "run.csv").read_text().startswith("time_s,A_angle_deg") and "C_color" in (
        reader / "run.csv"
    ).read_text()


def test_commands_for_hubs_exist() -> None:
    assert {words[0] for words in PAGE.listed} == set(LINE.commands)
    for words in README.commands + PAGE.commands + PAGE.listed:
        assert callable(parse(LINE, words).execute), words


def test_its_test_and_its_workflow_pass(reader: Path) -> None:
    (job,) = yaml.safe_load(README.blocks("yaml")[0])["jobs"].values()
    *_, install, test = (shlex.split(step["run"]) for step in job["steps"] if "run" in step)
    assert install[:3] == ["pip", "install", "pytest"] and test == ["pytest"]
    address = tomllib.loads((FOLDER.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))[
        "tool"
    ]["bricksrl"]["address"]
    assert install[3] == f"brickhub @ git+{address}#subdirectory=packages/{FOLDER.name}"
    command = [sys.executable, "-m", *test, "-p", "no:cacheprovider"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0 and "1 passed" in done.stdout, done.stdout


def test_the_link_answers(capfd: pytest.CaptureFixture[str]) -> None:
    exec(link(), {})  # noqa: S102
    angle, distance = eval(capfd.readouterr().out)  # noqa: S307
    assert abs(angle - 45) < 3 and distance == 2000.0


def test_the_robot_that_learns_learns(capfd: pytest.CaptureFixture[str]) -> None:
    exec("\n".join(PAGE.blocks("python")), {})  # noqa: S102
    _, said = capfd.readouterr().out.splitlines()
    speed, lag = eval(said)  # noqa: S307
    assert speed < -0.5, "legs that turn fast turn far"
    assert 0.0 <= lag <= 360.0
