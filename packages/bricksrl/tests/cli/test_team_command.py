"""`bricksrl team`: robots that share one world."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from videos import read_video

from bricksrl.cli import team_command as team
from bricksrl.cli.app import run
from bricksrl.cli.team_command import TrainTeam
from bricksrl.errors import RenderingUnavailableError, UnknownNameError
from bricksrl.training.checkpoint import save_checkpoint
from bricksrl.training.teams import groups
from bricksrl.training.teams import team as teams


@pytest.mark.slow
def test_team_is_trained_played_and_played_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "team",
        "Tag-v0",
        "--copies",
        "8",
        "--frames",
        "2048",
        "--episodes",
        "1",
        "--run",
        str(tmp_path / "tag"),
    ]
    assert run(command) == 0
    shown = capsys.readouterr().out
    assert "Tag-v0, seed 0: catcher by ippo; " in shown and "step 2048/2048" in shown
    assert f"team            {tmp_path / 'tag' / 'team.bin'}" in shown
    film = tmp_path / "tag" / "film.mp4"
    assert film.exists() or "film            none:" in shown
    if film.exists():
        frames = read_video(film)
        first, later = (frames[index].astype(int) for index in (0, len(frames) // 4))
        assert np.count_nonzero(np.abs(later - first) > 60) > 200, "the robots move"
    success = next(line for line in shown.splitlines() if line.startswith("success"))
    assert run(["team", "--play", str(tmp_path / "tag"), "--episodes", "1"]) == 0
    assert capsys.readouterr().out.splitlines() == [success]
    assert run(command) == 2 and "exists already" in capsys.readouterr().err


@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_keeps_the_team_and_a_second_one_ends_at_once(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    presses: int,
) -> None:
    printed: list[str] = []

    def press(line: str) -> None:
        printed.append(line)
        for _ in range(presses if line.startswith("step") else 0):
            signal.raise_signal(signal.SIGINT)

    folder = tmp_path / "a team"
    monkeypatch.setattr(team, "print_line", press)
    assert (
        run(["team", "Tag-v0", "--copies", "8", "--frames", "20000", "--run", str(folder)]) == 130
    )
    errors = capsys.readouterr().err
    assert len(printed) == 2, "one line of progress"
    if presses == 2:
        assert errors == "interrupted: nothing was saved\n" and not folder.exists()
        return
    assert errors == (
        f"interrupted: the team is in {folder}; `bricksrl team --play '{folder}'` plays with it\n"
    )
    monkeypatch.undo()
    assert (
        run(["team", "--play", str(folder), "--episodes", "1"]) == 0
        and "of 1 episode" in capsys.readouterr().out
    )


def test_options_make_the_configuration() -> None:
    config = TrainTeam(agent="sac", learn=("runner",), seed=3).config("Tag-v0")
    assert (config.agents, config.scripts) == ({"runner": "sac"}, {"catcher": "chase"})
    assert (config.copies, config.frames, config.seed) == (256, 300_000, 3)
    first = TrainTeam().config("Tag-v0")
    assert (first.agents, first.scripts) == ({"catcher": "ippo"}, {"runner": "flee,random"}), (
        "the first group learns, against a runner that it does not know by heart"
    )
    both = TrainTeam(learn=("catcher", "runner"), copies=0, frames=7).config("Tag-v0")
    assert (both.agents, both.scripts, both.copies, both.frames) == (
        {"catcher": "sac", "runner": "sac"},
        {},
        0,
        7,
    )
    carry = TrainTeam().config("Carry-v0")
    assert (carry.agents, carry.copies, carry.frames) == ({"agents": "sac"}, 0, 10_000), (
        "the beam has no simulation"
    )
    assert [TrainTeam(deaf=deaf).config("Guide-v0").deaf for deaf in (False, True)] == [False, True]


def test_invalid_teams_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(
        UnknownNameError, match="Tag-v0 has no group 'seeker'; choose catcher, runner"
    ):
        TrainTeam(learn=("seeker",)).config("Tag-v0")
    with pytest.raises(UnknownNameError, match="there is no arena 'Walker-v0'"):
        TrainTeam().config("Walker-v0")
    assert (
        run(["team", "Tag-v0", "--episodes", "0"]) == 2
        and "episodes is 0; give 1" in capsys.readouterr().err
    )
    assert (
        run(["team"]) == 2
        and "name an arena to train in (Tag-v0, Carry-v0, Guide-v0)" in capsys.readouterr().err
    )
    assert (
        run(["team", "--play", str(tmp_path)]) == 2
        and "there is no team in" in capsys.readouterr().err
    )
    save_checkpoint(tmp_path / "run" / "team.bin", {"agent": {}})
    assert run(["team", "--play", str(tmp_path / "run")]) == 2
    assert (
        "team.bin has no team (KeyError: 'config'); choose another file" in capsys.readouterr().err
    )
    assert (
        run(["team", "Tag-v0", "--play", str(tmp_path / "run")]) == 2
        and "omit ARENA or --play" in capsys.readouterr().err
    )
    for option in (
        ["--agent", "sac"],
        ["--learn", "runner"],
        ["--frames", "7"],
        ["--copies", "0"],
        ["--run", "x"],
    ):
        assert run(["team", "--play", str(tmp_path / "run"), *option]) == 2
        assert capsys.readouterr().err == f"error: {option[0]} has no effect with --play; omit it\n"
    assert (
        run(["team", "Tag-v0", "--frames", "0"]) == 2
        and "frames is 0; give a whole number from 1" in capsys.readouterr().err
    )
    for copies in ("-1", "1000000000"):
        assert (
            run(["team", "Tag-v0", "--copies", copies]) == 2
            and "give a whole number from 0 to 65,536" in capsys.readouterr().err
        )
    assert run(["list", "--json"]) == 0 and json.loads(capsys.readouterr().out)["arenas"] == [
        "Tag-v0",
        "Carry-v0",
        "Guide-v0",
    ]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (("--frames", "0"), "frames is 0; give a whole number from 1 to 1,000,000,000"),
        (("--copies", "-3"), "copies is -3; give a whole number from 0 to 65,536"),
    ],
)
def test_wrong_number_is_named(
    capsys: pytest.CaptureFixture[str], wrong: tuple[str, str], says: str
) -> None:
    assert run(["team", "Tag-v0", *wrong]) == 2
    assert capsys.readouterr().err == f"error: {says}\n"


def test_what_is_kept_of_a_team_is_said_with_the_command_for_it(tmp_path: Path) -> None:
    folder = tmp_path / "my team"
    folder.mkdir()
    assert team._kept(folder) == "nothing was saved"
    (folder / team.TEAM_FILE).touch()
    says = f"the team is in {folder}; `bricksrl team --play '{folder}'` plays with it"
    assert team._kept(folder) == says


def test_the_page_of_an_arena_shows_its_latest_team_or_its_scripts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(team, "make_arena", lambda env: f"arena {env}")
    monkeypatch.setattr(groups, "team_policy", lambda *given: given)
    monkeypatch.setattr(teams, "load_team", lambda path: SimpleNamespace(policy=path))
    scripts = {"catcher": "chase", "runner": "flee"}
    assert team._latest_policy("Tag-v0") == (("arena Tag-v0", {}, scripts), "by script")
    made = []
    for number, name in enumerate(("Tag-v0-sac-0-x", "Tag-v0-ippo-1-x", "Carry-v0-sac-0-x")):
        made.append(Path("runs") / name / team.TEAM_FILE)
        made[-1].parent.mkdir(parents=True)
        made[-1].touch()
        os.utime(made[-1], (0, 100 - 10 * number))
    assert team._latest_policy("Tag-v0") == (made[0], str(made[0].parent))
    os.utime(made[1], (0, 200))
    assert team._latest_policy("Tag-v0") == (made[1], str(made[1].parent))


@pytest.mark.parametrize("has_folder", [True, False])
def test_a_team_that_plays_is_told_and_filmed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    has_folder: bool,
) -> None:
    asked, closed = [], []
    env = SimpleNamespace(close=lambda: closed.append(True))
    monkeypatch.setattr(
        team, "make_arena", lambda *given, **named: asked.append((given, named)) or env
    )
    played = [
        teams.TeamEpisode(success, length, {}) for success, length in ((True, 30), (False, 81))
    ]
    monkeypatch.setattr(teams, "play_team", lambda *given: asked.append(given) or played)

    def film(*_: object) -> None:
        raise RenderingUnavailableError("no OpenGL")

    monkeypatch.setattr("bricksrl.evaluation.film.film_arena", film)
    config = TrainTeam(deaf=True, seed=4).config("Guide-v0")
    trained = SimpleNamespace(policy="policy", config=config)
    command = TrainTeam(episodes=2, seed=4)
    command._play(trained, tmp_path if has_folder else None)  # type: ignore[arg-type]
    assert asked[0] == (("Guide-v0",), {"deaf": True})
    assert asked[1][:3] == (env, "policy", 2) and closed == [True]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "success         1 of 2 episodes in the arena, 55.5 steps on average"
    folder = [f"team            {tmp_path / team.TEAM_FILE}", "film            none: no OpenGL"]
    assert lines[1:] == (folder if has_folder else [])
    for seed in (4, 5):
        replace(command, seed=seed)._play(trained, None)  # type: ignore[arg-type]
    first, again, other = (given[3] for given in asked[1::2])
    assert first == again != other, "the seed draws the episodes"


@pytest.mark.parametrize("frames", [10, 1000])
def test_a_team_s_training_has_at_most_twenty_lines(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    frames: int,
) -> None:
    def train(config: Any, *, on_progress: Any, stop: object) -> SimpleNamespace:
        for done in range(1, config.frames + 1):
            returns = {"catcher": 0.5 * done, "runner": -1.0}
            on_progress(teams.TeamProgress(done, done // 2, returns, 0.25))
        return SimpleNamespace(save=lambda path: path.write_bytes(b"team"))

    monkeypatch.setattr(teams, "train_team", train)
    command = TrainTeam(frames=frames, seed=3)
    command._train(command.config("Tag-v0"), tmp_path)
    first, *lines = capsys.readouterr().out.splitlines()
    assert first == f"Tag-v0, seed 3: catcher by ippo; {tmp_path}"
    assert lines[-1] == (
        f"step {frames}/{frames}  {frames // 2} episodes  "
        f"return catcher {0.5 * frames:g}  runner -1  success 25 %"
    )
    steps = [int(line.split()[1].partition("/")[0]) for line in lines]
    # Without an episode there is nothing to tell.
    assert steps == ([*range(2, 11)] if frames == 10 else [*range(50, 1001, 50)])
    assert (tmp_path / team.TEAM_FILE).read_bytes() == b"team"
