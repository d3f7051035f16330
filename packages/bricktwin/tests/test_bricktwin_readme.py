"""The README of bricktwin: its commands, its programs and its test do what it says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from readme import Readme, needs_a_hub

from brickhub.cli.app import parse
from brickhub.pytest_plugin import PybricksHub
from bricktwin.cli import main
from bricktwin.cli.command_table import LINE

FOLDER = Path(__file__).parents[1]
README = Readme(FOLDER / "README.md", "bricktwin")
MINUTES = (["twin", "fit"],)


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of somebody who has copied all files of the README, and has drawn a robot."""
    monkeypatch.chdir(tmp_path)
    assert README.write_files(tmp_path) == ["walk.py", "steer.py", "test_steer.py"]
    shutil.copy(FOLDER.parents[1] / "examples" / "13_front_steered.ldr", tmp_path / "my_robot.ldr")
    return tmp_path


def cheap(words: list[str]) -> list[str]:
    """The command without a film, and with few steps."""
    if "--video" in words:
        at = words.index("--video")
        return words[:at] + words[at + 2 :]
    return [*words, "--steps", "3"] if words[:2] == ["twin", "record"] else words


def test_what_is_shown_is_printed(reader: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert README.consoles
    for words, output in README.consoles:
        code = main(words)
        told = capfd.readouterr()
        if "no OpenGL" in told.err:
            pytest.skip(told.err)
        assert (code, told.out) == (0, output), told.err
    assert (reader / "drive.mp4").stat().st_size > 100_000


def test_commands_run(
    reader: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bricktwin.plans.booklet.pages.DPI", 60)  # `test_booklet.py` draws in full
    done = [
        words for words in README.commands if words[:2] not in MINUTES and not needs_a_hub(words)
    ]
    assert len(done) >= 7
    for words in done:
        assert main(cheap(words)) == 0, (words, capfd.readouterr().err)
    made = {path.name for path in reader.iterdir()}
    assert {"run.csv", "wanted.xml", "my_robot.pdf", "robot.jsonl"} <= made


def test_all_commands_are_there() -> None:
    groups = {(group, name) for group, (_, commands) in LINE.groups.items() for name in commands}
    listed = {tuple(words[:2]) for words in README.listed if words[0] in LINE.groups}
    assert listed == groups
    single = {words[0] for words in README.listed if words[0] not in LINE.groups}
    assert single == set(LINE.commands)
    for words in README.commands + README.listed:
        assert callable(parse(LINE, words).execute), words


def test_its_test_passes(reader: Path) -> None:
    names: dict[str, object] = {}
    exec((reader / "test_steer.py").read_text(), names)  # noqa: S102
    names["test_it_turns_left"](PybricksHub(reader, reader))  # type: ignore[operator]
