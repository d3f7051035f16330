"""What a training prints and writes, and which options and words it takes."""

from __future__ import annotations

import re
import shutil

import pytest

from bricksrl.cli.app import parse
from bricksrl.cli.progress import clock, sparkline
from bricksrl.cli.train import Train
from bricksrl.training import RunFolder
from bricksrl.training.config import RunOptions


def test_train_prints_progress(trained):
    _, done = trained
    assert (done.returncode, done.stderr) == (0, "")
    lines = re.findall(
        r"^episode (\d)/4  return -?\d\S*  \S+ steps/s  \d+:\d\d left", done.stdout, re.MULTILINE
    )
    assert lines == ["1", "2", "3", "4"]
    assert re.search(r"^return   -?\d\S* ± \S+", done.stdout, re.MULTILINE)


def test_train_writes_files(trained):
    run_dir, done = trained
    folder = RunFolder(run_dir)
    assert folder.curve_path.read_bytes().startswith(b"\x89PNG")
    assert len(folder.read_episodes()) == 4
    assert folder.read_config().seed == 3
    for path in (folder.curve_path, folder.checkpoint_path, folder.evaluation_path):
        assert path.exists()
    assert str(folder.curve_path) in done.stdout


@pytest.mark.parametrize(
    ("env", "episodes"),
    [
        ("RunAway-v0", 40),
        ("Spinning-v0", 15),
        ("Walker-v1", 75),
        ("Walker-v2", 12),
        ("RoboArmSim-v0", 250),
    ],
)
def test_default_episodes_follow_environment(env, episodes):
    assert Train(env).config(env).episodes == episodes
    assert Train(env, episodes=3).config(env).episodes == 3


@pytest.mark.parametrize(("copies", "episodes"), [(1, 75), (256, 75), (4096, 24), (100_000, 1)])
def test_thousands_of_copies_train_for_fewer_episodes_each(copies, episodes):
    learning = RunOptions(num_envs=copies)
    assert Train("WalkerSim-v0", learning=learning).config("WalkerSim-v0").episodes == episodes
    given = Train("WalkerSim-v0", episodes=75, learning=learning)
    assert given.config("WalkerSim-v0").episodes == 75


def test_options_are_passed_to_run(tmp_path):
    (tmp_path / "best.json").write_text('{"settings": {"gamma": 0.9, "hidden": [32, 32]}}')
    train = parse(
        (
            "train",
            "Walker-v0",
            "--settings",
            str(tmp_path / "best.json"),
            "--set",
            "gamma=0.8",
            "--set",
            "tau=0.5",
            "--realtime",
        )
    )
    config = train.config("Walker-v0")
    assert (config.settings.gamma, config.settings.tau, config.settings.hidden) == (
        0.8,
        0.5,
        (32, 32),
    )
    assert config.asynchronous
    for option, asynchronous in (("--synchronous", False), ("--asynchronous", True)):
        assert (
            parse(("train", "Walker-v0", "--realtime", option)).config("Walker-v0").asynchronous
            is asynchronous
        )
    config = parse(
        ("train", "Walker-v0", "--hub", "ble:Robbie", "--patience-s", "7", "--log", "wandb")
    ).config("Walker-v0")
    assert (config.hub, config.asynchronous, config.patience_s, config.log) == (
        "ble:Robbie",
        True,
        7.0,
        "wandb",
    )


def test_existing_folder_is_unchanged(fails, trained):
    run_dir, _ = trained
    before = {path: path.read_bytes() for path in run_dir.rglob("*") if path.is_file()}
    fails("train", "RunAway-v0", "--run", str(run_dir), says="exists already")
    assert {path: path.read_bytes() for path in run_dir.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("RunAwya-v0",), "RunAway-v0"),
        (("RunAway-v0", "--agent", "sca"), "sca"),
        (("RunAway-v0", "--preset", "papr"), "paper"),
        (("RunAway-v0", "--episodes", "0"), "episodes"),
        (("RunAway-v0", "--set", "learning_rat=1"), "learning_rate"),
        (("RunAway-v0", "--set", "gamma=big"), "gamma"),
        (("RunAway-v0", "--settings", "no-such-file.json"), "no-such-file.json"),
        (("RunAway-v0", "--hub", "wifi"), "wifi"),
        (("RunAway-v0", "--synchronous", "--asynchronous"), "choose one"),
        (("RunAway-v0", "--patience-s", "-1"), "patience_s"),
        (("RunAway-v0", "--seeds", "1"), "seeds"),
        (("RunAway-v0", "--resume", "runs/spin"), "--resume"),
        (
            ("RunAway-v0", "--page-port", "9000"),
            "--page-port has no effect without --page; omit it",
        ),
        (("RunAway-v0", "--seeds", "2", "--page"), "omit --seeds, or --page"),
        (
            ("RunAway-v0", "--seeds", "2", "--take-over", "keyboard"),
            "omit --seeds, or --page and --take-over",
        ),
        (
            ("RunAway-v0", "--eval-episodes", "9"),
            "--eval-episodes has no effect without --eval-every",
        ),
        ((), "environment"),
    ],
)
def test_wrong_names_and_numbers_print_one_line(fails, tmp_path, arguments, says):
    run_dir = tmp_path / "run"
    fails("train", *arguments, "--run", str(run_dir), says=says)
    assert not run_dir.exists()


@pytest.mark.parametrize(
    "option",
    [
        ("--agent", "td3"),
        ("--set", "gamma=0.9"),
        ("--base", "scripted"),
        ("--seed", "3"),
        ("--option", "sparse=true"),
        ("--take-over", "keyboard"),
        ("--page-port", "9000"),
    ],
)
def test_resume_ignores_no_option(fails, option):
    fails("train", "--resume", "runs/spin", *option, says=f"{option[0]} has no effect with")


def test_resume_extends_finished_run(bricksrl, trained, tmp_path):
    run_dir = tmp_path / "run"
    shutil.copytree(trained[0], run_dir)
    done = bricksrl("train", "--resume", str(run_dir), "--episodes", "5")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.findall(r"^episode (\d/\d)", done.stdout, re.MULTILINE) == ["5/5"]
    assert len(RunFolder(run_dir).read_episodes()) == 5


def test_resume_of_missing_run_prints_one_line(fails, tmp_path):
    fails("resume", str(tmp_path), says=str(tmp_path))


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0:00"), (59.6, "1:00"), (754, "12:34"), (3661, "1:01:01")]
)
def test_clock(seconds, text):
    assert clock(seconds) == text


def test_sparkline():
    assert sparkline([0.0, 3.5, 7.0]) == "▁▅█"
    assert sparkline([2.0, 2.0]) == "▅▅"
