"""Recordings: placing the robot, films, the ways to the hub, signals."""

from __future__ import annotations

import contextlib
import io
import os
import signal

import numpy as np
import pytest

from brickhub.errors import HubNotFoundError
from brickhub.hub.transport import Pipe
from brickhub.virtual.panel import Press
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.cli import main
from bricksrl.cli.progress import RunProgress
from bricksrl.cli.terminal import placing
from bricksrl.data import load
from bricksrl.envs import make
from bricksrl.errors import RunError
from bricksrl.evaluation.film import filmed_env
from bricksrl.training import RunFolder


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


def test_button_of_the_hub_discards_the_episode(tmp_path, monkeypatch, capsys):
    """The press is in the first try of the first episode."""
    presses = [Press("left", 3.0, 1.5)]

    def press(connection):
        while presses:
            connection.twin.machine.panel.press(presses.pop())

    def made(*args, **options):
        env = make(*args, **options)
        env.watch(press)
        return env

    monkeypatch.setattr("bricksrl.cli.record.make", made)
    for name, more in (("pressed", ["--discard-button", "left"]), ("plain", [])):
        command = ["record", "RunAway-v0", "--episodes", "2", "--out", str(tmp_path / name)]
        assert main([*command, *more]) == 0
        told = capsys.readouterr()
        assert ("discarded; this episode is recorded again" in told.err) is (name == "pressed")
    pressed, plain = (load(tmp_path / name) for name in ("pressed", "plain"))
    assert [row.about.seed for row in pressed.rows] == [row.about.seed for row in plain.rows]
    assert pressed.observation.shape[1:] == plain.observation.shape[1:]
    assert main([*command, "--discard-button", "up"]) == 2
    assert "the hub has no such button" in capsys.readouterr().err


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
