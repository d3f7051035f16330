"""Faults of a real robot, practised on a virtual one: the page "Find the fault", and environments
with faults."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import brickhub.cli
import bricksrl
from brickhub.cli.app import parse
from brickhub.virtual.faults import FAULT_KINDS, FaultyBody
from bricksrl.cli import main
from bricksrl.cli.app import LINE
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.errors import BricksError

PAGE = (Path(__file__).parents[4] / "docs" / "practice.md").read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings, and calibrations in them, of this test alone."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr("sys.stdin", None)


def test_the_table_of_the_page_is_that_of_the_kinds() -> None:
    rows = re.findall(r"^\| (`.*) \|$", PAGE, re.MULTILINE)
    assert rows == [
        f"`{kind.example}` | {kind.does} | {kind.seen} | {kind.remedy}"
        for kind in FAULT_KINDS.values()
    ]


def test_the_exercises_show_what_the_page_says(capfd: pytest.CaptureFixture[str]) -> None:
    """Commands and the lines that they print, in the order of the page."""
    printed = ""
    steps = re.findall(
        r"^    (bricksrl hub .*|brickhub .*)$|^```text\n((?:[^`\n].*\n)*)```", PAGE, re.MULTILINE
    )
    assert len(steps) == 14
    for command, block in steps:
        if command:
            program, *words = shlex.split(command)
            (main if program == "bricksrl" else brickhub.cli.main)(words)
            printed = capfd.readouterr().out
        for line in block.splitlines():
            assert line in printed.splitlines(), (command, printed)
    assert "reversed" not in printed


def first_distances(fault: tuple[str, ...], steps: int = 3) -> list[float]:
    """Distance at the end of each step of an environment."""
    robot = make("RunAway-v0", EnvOptions(link="mac", fault=fault), seed=0, arrays=True)
    assert robot is not None
    index = [entry.name for entry in robot.task.entries].index("distance")
    try:
        robot.begin()
        return [float(robot.move([1.0])[index]) for _ in range(steps)]
    finally:
        robot.close()


def test_an_environment_has_the_fault_and_the_calibration_that_mends_it() -> None:
    sound, wrong = first_distances(()), first_distances(("reversed:left",))
    assert max(abs(a - b) for a, b in zip(sound, wrong, strict=True)) > 50
    assert set(first_distances(("dead:eyes",))) == {2000.0}
    brickhub.cli.main(("calibrate", "RunAway-v0", "--hub", "virtual", "--reverse", "left"))
    mended = first_distances(("reversed:left",))
    assert mended == pytest.approx(sound, abs=15)
    assert first_distances(()) == sound, "a robot without faults is as described"


def test_options_take_faults() -> None:
    words = ["train", "RunAway-v0", "--fault", "battery=6.2", "--fault", "reversed:left"]
    assert parse(LINE, words).execute is not None
    assert EnvOptions(fault="battery=6.2").fault == ("battery=6.2",)  # type: ignore[arg-type]
    assert EnvOptions(fault=["link=12s"]).fault == ("link=12s",)  # type: ignore[arg-type]
    with pytest.raises(BricksError, match="did you mean 'battery'"):
        EnvOptions(fault=("batery=6",))
    with pytest.raises(BricksError, match="a real robot has its own"):
        bricksrl.make("RunAway-v0", hub="ble", fault="battery=6.2")
    with pytest.raises(BricksError, match="simulated without a robot"):
        bricksrl.make("WalkerSim-v0", fault="battery=6.2")


@pytest.mark.slow
def test_an_episode_ends_where_the_link_breaks() -> None:
    env = bricksrl.make("RunAway-v0", link="mac", fault="link=4s", seed=0)
    assert isinstance(env.twin.body, FaultyBody)
    try:
        lost = [bool(env.rollout(30)["next", "link_lost"].any()) for _ in range(2)]
        assert lost == [True, False]
    finally:
        env.close()
