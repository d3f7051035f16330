"""``bricksrl train`` and ``resume``: files, output, Ctrl-C."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import signal
import sys
import time
from functools import partial
from types import SimpleNamespace

import imageio_ffmpeg
import numpy as np
import pytest
from videos import read_video

from brickhub.errors import HubNotFoundError
from brickhub.hub.transport import Pipe
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.cli import main
from bricksrl.cli.app import parse
from bricksrl.cli.progress import RunProgress, clock, sparkline
from bricksrl.cli.terminal import placing
from bricksrl.cli.train import Train
from bricksrl.data import load
from bricksrl.envs import make
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.errors import RunError
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.film import film_run, filmed_env, side_by_side
from bricksrl.evaluation.report import write_report
from bricksrl.training import RunFolder


def without_notes(stderr):
    """What a command says at its end, without its notes that it goes on saving: it has them where
    a computer is so busy that an end takes longer than a second."""
    return re.sub(r"^(ending, and|still) saving.*\n", "", stderr, flags=re.MULTILINE)


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


def test_no_video_without_opengl(trained):
    run_dir, done = trained
    assert not (run_dir / "video.mp4").exists()
    assert (
        len(
            re.findall(
                r"^video           none: .*OpenGL|^video           none: .*drawn",
                done.stdout,
                re.MULTILINE,
            )
        )
        == 1
    )


def test_report_without_videos(trained):
    run_dir, done = trained
    text = (run_dir / "report.html").read_text()
    assert f"report          {run_dir / 'report.html'}" in done.stdout
    assert (
        "<h1>RunAway-v0" in text
        and "There is no film" in text
        and f"bricksrl play {run_dir} --page" in text
    )
    assert (
        text.count("data:image/png;base64,") == 1
        and f"written by hand {REFERENCES['RunAway-v0']['by hand']:g}" in text
    )


def test_report_with_videos(trained, tmp_path, monkeypatch):
    monkeypatch.setattr("bricksrl.evaluation.report.FILM_BUDGET_S", 0.5)
    monkeypatch.setattr("bricksrl.evaluation.report.film_run", partial(film_run, size=(192, 108)))
    monkeypatch.setattr("bricksrl.evaluation.report.side_by_side", partial(side_by_side, height=54))
    run_dir = tmp_path / "run"
    shutil.copytree(trained[0], run_dir)
    path, said = write_report(
        run_dir, RunFolder(run_dir).read_episodes(), evaluate(run_dir, episodes=1, save=False)
    )
    if said.startswith("none"):
        pytest.skip(said)
    images = {}
    for name in ("before", "after", "before_after"):
        frames = read_video(run_dir / f"{name}.mp4")
        assert frames.shape[1:] == ((54, 192, 3) if name == "before_after" else (108, 192, 3))
        assert imageio_ffmpeg.count_frames_and_secs(str(run_dir / f"{name}.mp4"))[1] >= 1
        images[name] = frames[:: max(1, len(frames) // 10)].astype(int)
    assert images["after"][0].std() > 5
    assert abs(images["after"][-1] - images["after"][0]).mean() > 1
    assert "data:video/mp4;base64," in path.read_text()


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
        ("train", "Walker-v0", "--hub", "ble:Robbie", "--patience", "7", "--log", "wandb")
    ).config("Walker-v0")
    assert (config.hub, config.asynchronous, config.patience_s, config.log) == (
        "ble:Robbie",
        True,
        7.0,
        "wandb",
    )


def test_user_is_asked_to_place_robot(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    placing(RunProgress().hidden)(np.random.default_rng())
    written = capsys.readouterr()
    assert "Enter" in written.err and not written.out
    with pytest.raises(RunError, match="terminal"):
        placing(RunProgress().hidden)(np.random.default_rng())


def test_record_asks_user_to_place_robot(tmp_path, monkeypatch, capsys):
    def make(env_id, options, *, place, **named):
        place(np.random.default_rng())
        raise HubNotFoundError(f"no hub at {options.hub}; switch it on")

    monkeypatch.setattr("bricksrl.cli.record.make", make)
    for answer, says in (("", "nobody can be asked"), ("\n", "no hub at usb:COM3")):
        monkeypatch.setattr("sys.stdin", io.StringIO(answer))
        assert (
            main(("record", "Spinning-v0", "--hub", "usb:COM3", "--out", str(tmp_path / "data")))
            == 2
        )
        written = capsys.readouterr().err
        assert "press Enter" in written and says in written


@pytest.mark.skipif(os.name != "posix", reason="SIGUSR1 is a thing of POSIX")
@pytest.mark.realtime
def test_signal_stops_recorded_robot(start, tmp_path):
    out = tmp_path / "data"
    recording = start("record", "Spinning-v0", "--realtime", "--episodes", "90", "--out", str(out))
    assert recording.stdout.readline().startswith("episode 1/90")
    recording.send_signal(signal.SIGUSR1)
    rest, said = recording.communicate(timeout=20)
    assert recording.returncode == 130 and "whole episode" in said and "dataset" not in rest
    assert len(load(out).rows) >= 1


def timing(dataset):
    """Mean age of observations and mean step time by the hub, seconds."""
    data = load(dataset)
    clock = data.hub_time_s[data.episode == 0]
    return data.age_s.mean().item(), (clock[1:] - clock[:-1]).mean().item()


@pytest.fixture
def pipes(monkeypatch):
    """Streams of the started programs."""
    started, start = [], VirtualHub.start
    monkeypatch.setattr(
        VirtualHub,
        "start",
        lambda self, program: (started.append(program.pipe), start(self, program)),
    )
    return started


def test_recording_shows_streaming_and_app_data(tmp_path, pipes):
    found = {}
    for option in ("--policy=random", "--streaming", "--app-data"):
        out = str(tmp_path / option)
        assert (
            main(
                ["record", "Spinning-v0", "--link", "mac", "--episodes", "1", "--out", out, option]
            )
            == 0
        )
        found[option] = timing(tmp_path / option)
    (age_s, period_s), (streamed_age_s, streamed_period_s), over_app_data = found.values()
    assert period_s > 0.115, "100 ms, and the link"
    assert streamed_period_s == pytest.approx(0.1, abs=0.001), "100 ms"
    assert 0.001 < age_s < 0.02 and 0.001 < streamed_age_s < 0.03, (
        "a connection interval, and 10 ms between observations"
    )
    assert over_app_data == pytest.approx((age_s, period_s), rel=0.1)
    assert pipes == [Pipe.STDIN, Pipe.STDIN, Pipe.APP_DATA]


def test_recording_names_its_film(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("bricksrl.evaluation.film.filmed_env", lambda *_: contextlib.nullcontext())
    out, video = tmp_path / "my data", tmp_path / "film.mp4"
    assert (
        main(["record", "RunAway-v0", "--episodes", "1", "--out", str(out), "--video", str(video)])
        == 0
    )
    written = capsys.readouterr().out
    assert (
        f"\nvideo           {video}\n" in written
        and f"\nlook at it      bricksrl data info '{out}'\n" in written
    )


def test_interrupted_recording_keeps_its_film(tmp_path):
    video = tmp_path / "film.mp4"
    env = make("RunAway-v0", seed=0)
    with (
        contextlib.closing(env),
        contextlib.suppress(KeyboardInterrupt),
        filmed_env(env, video, "run away", size=(320, 180)),
    ):
        env.rollout(3)
        raise KeyboardInterrupt
    assert video.stat().st_size > 3_000


def test_train_with_streaming(tmp_path, pipes, monkeypatch):
    monkeypatch.setattr("bricksrl.cli.train._report", lambda *_, **__: None)
    run_dir = tmp_path / "run"
    options = (
        "--agent",
        "random",
        "--episodes",
        "1",
        "--streaming",
        "--app-data",
        "--link",
        "mac",
        "--run",
        str(run_dir),
    )
    assert main(["train", "Spinning-v0", *options]) == 0
    assert timing(run_dir)[1] == pytest.approx(0.1, abs=0.001) and pipes == [Pipe.APP_DATA]
    config = RunFolder(run_dir).read_config()
    assert config.streaming and config.app_data and config.link == "mac", (
        "evaluated and resumed alike"
    )


def test_unstreamable_task_prints_one_line(fails, tmp_path):
    fails(
        "train", "RunAway-v0", "--streaming", "--run", str(tmp_path / "run"), says="omit streaming"
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
        (("RunAway-v0", "--patience", "-1"), "patience"),
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


@pytest.mark.parametrize(
    ("env", "hub", "realtime"), [("Walker-v0", "virtual", True), ("Walker-v0", "ble", False)]
)
def test_only_a_virtual_robot_is_driven_in_real_time(env, hub, realtime):
    command = parse(["train", env, "--hub", hub, "--take-over", "gamepad"])
    assert command.config(env).realtime is realtime, "a real robot has its own time"


class Pad:
    """A gamepad whose stick is held up."""

    def read(self):
        return [1.0], 1

    def close(self):
        pass


@pytest.mark.parametrize("command", ["train", "record"])
def test_human_takes_over_in_a_simulation(command, tmp_path, monkeypatch, capfd):
    naps = []
    monkeypatch.setattr("bricksrl.teleoperation.find_pad", Pad)
    monkeypatch.setattr(
        "bricksrl.teleoperation.time", SimpleNamespace(perf_counter=lambda: 0.0, sleep=naps.append)
    )
    monkeypatch.setattr("bricksrl.cli.train._report", lambda *_, **__: None)
    out = (
        ("--run", str(tmp_path / "run"))
        if command == "train"
        else ("--out", str(tmp_path / "run/data"))
    )
    assert main([command, "WalkerSim-v0", "--take-over", "gamepad", "--episodes", "1", *out]) == 0
    recorded = load(tmp_path / "run")
    assert recorded.intervention.tolist() == [True, False] * 50
    assert naps == [0.25 * (step + 1) for step in range(100)], "as fast as a robot"


@pytest.mark.realtime
def test_fleet_learns_on_a_page(forked_children, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("bricksrl.evaluation.report.film_run", partial(film_run, size=(192, 108)))
    command = [
        "train",
        "RunAway-v0",
        "--agent",
        "random",
        "--robots",
        "2",
        "--episodes",
        "2",
        "--run",
        str(tmp_path / "run"),
    ]
    assert main([*command, "--page"]) == 0
    assert len(RunFolder(tmp_path / "run").read_episodes()) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
def test_ctrl_c_saves_and_resume_continues(start, fails, tmp_path):
    run_dir = tmp_path / "run"
    child = start("train", "RunAway-v0", "--episodes", "500", "--run", str(run_dir))
    for line in child.stdout:
        if line.startswith("episode 3/"):
            break
    child.send_signal(signal.SIGINT)
    _, stderr = child.communicate(timeout=60)
    assert child.returncode == 130
    found = re.fullmatch(
        rf"interrupted: saved (\d+) episodes? in {run_dir}; `bricksrl resume {run_dir}` goes on\n",
        without_notes(stderr),
    )
    assert found, stderr
    saved = RunFolder(run_dir).read_episodes()
    assert len(saved) == int(found[1]) >= 3
    assert RunFolder(run_dir).curve_path.exists()

    fails("resume", str(run_dir), "--episodes", "2", says="500")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
@pytest.mark.realtime
def test_ctrl_c_while_robot_is_out_of_reach(start, tmp_path):
    child = start("train", "RunAway-v0", "--hub", "usb:COM99", "--run", str(tmp_path / "run"))
    assert child.stdout.readline().startswith("the robot is out of reach (")
    child.send_signal(signal.SIGINT)
    _, stderr = child.communicate(timeout=60)
    ended = "interrupted: no episode was finished, so nothing was saved\n"
    said = f"connecting to the robot (usb:COM99)\n{ended}"
    assert (child.returncode, without_notes(stderr)) == (130, said)
    assert not (tmp_path / "run").exists()


def test_resume_extends_finished_run(bricksrl, trained, tmp_path):
    run_dir = tmp_path / "run"
    shutil.copytree(trained[0], run_dir)
    done = bricksrl("train", "--resume", str(run_dir), "--episodes", "5")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.findall(r"^episode (\d/\d)", done.stdout, re.MULTILINE) == ["5/5"]
    assert len(RunFolder(run_dir).read_episodes()) == 5


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
@pytest.mark.parametrize("delay_s", [0.5, 2.0])
def test_ctrl_c_before_first_episode_prints_one_line(bricksrl, start, tmp_path, delay_s):
    began_s = time.perf_counter()
    assert bricksrl("--help").returncode == 0
    # before that Ctrl-C meets the interpreter, not the command
    until_it_runs_s = time.perf_counter() - began_s
    child = start("train", "RunAway-v0", "--episodes", "500", "--run", str(tmp_path / "run"))
    time.sleep(max(delay_s, until_it_runs_s))  # while modules are loaded; later on a fast computer
    child.send_signal(signal.SIGINT)
    _, stderr = child.communicate(timeout=60)
    assert child.returncode == 130
    # Once the robot moves, its stop is told before.
    assert re.fullmatch(
        r"(stopped by hand\n)?interrupted: [^\n]*saved[^\n]*\n", without_notes(stderr)
    ), stderr


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


@pytest.mark.slow  # the same of an environment is quick
def test_missing_graphics_library_disables_pictures_only(bricksrl, tmp_path):
    process = bricksrl(
        "train",
        "Spinning-v0",
        "--agent",
        "random",
        "--episodes",
        "1",
        "--run",
        str(tmp_path / "run"),
        MUJOCO_GL="bogus",
    )
    assert process.returncode == 0 and "video           none: " in process.stdout
    assert process.stderr.count("MUJOCO_GL=bogus does not work") == 1
