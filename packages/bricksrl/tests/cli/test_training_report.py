"""Report and films at the end of a training."""

from __future__ import annotations

import html
import re
import shutil
from functools import partial
from pathlib import Path

import imageio_ffmpeg
import pytest
from videos import read_video

from bricksrl.cli import main
from bricksrl.envs import get_task
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.errors import RenderingUnavailableError, TwinError
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.film import film_run, side_by_side
from bricksrl.evaluation.report import write_report
from bricksrl.training import RunFolder

EXAMPLES = Path(__file__).parents[4] / "examples"


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
        and f"<p>{html.escape(get_task('RunAway-v0').summary)}</p>" in text
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


FILMING = "filming before and after, and writing the report"


def lines_of_training(capfd, run_dir, *words):
    options = ("--agent", "random", "--episodes", "1", "--run", str(run_dir))
    assert main(["train", *words, *options]) == 0
    return capfd.readouterr().out.splitlines()


def test_film_is_announced_where_it_is_made(tmp_path, capfd, monkeypatch):
    def film(*_):
        raise TwinError("not in this test")

    monkeypatch.setattr("bricksrl.evaluation.report.film_before_and_after", film)
    lines = lines_of_training(capfd, tmp_path / "run", "RunAway-v0")
    if "OpenGL" in lines[-3]:
        pytest.skip(lines[-3])
    assert FILMING in lines and "video           none: not in this test" in lines


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("RunAway-v0", "--no-film"), "left out"),
        ((str(EXAMPLES / "04_own_robot.py"),), "its robot lies on a bench"),
        (("WalkerSim-v0",), "no virtual robot to film"),
    ],
)
def test_film_that_cannot_be_made_is_not_announced(tmp_path, capfd, words, reason):
    lines = lines_of_training(capfd, tmp_path / "run", *words)
    assert [line for line in lines if "writing the report" in line] == ["writing the report"]
    assert any(line.startswith("video           none: ") and reason in line for line in lines)


def test_film_without_opengl_is_not_announced(tmp_path, capfd, monkeypatch):
    def fail(*_, **__):
        raise RenderingUnavailableError("no OpenGL library works here; install one")

    monkeypatch.setattr("bricksrl.evaluation.film.Renderer", fail)
    lines = lines_of_training(capfd, tmp_path / "run", "RunAway-v0")
    assert "writing the report" in lines
    assert "video           none: no OpenGL library works here; install one" in lines


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
