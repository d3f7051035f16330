"""Ctrl-C before, in and after the episodes of a training."""

from __future__ import annotations

import re
import signal
import sys
import time

import pytest

from bricksrl.training import RunFolder


def without_notes(stderr):
    """What a command says at its end, without its notes that it goes on saving: it has them where
    a computer is so busy that an end takes longer than a second."""
    return re.sub(r"^(ending, and|still) saving.*\n", "", stderr, flags=re.MULTILINE)


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
        r"(stopped by hand\n)?interrupted: [^\n]*(saved|begins again)[^\n]*\n",
        without_notes(stderr),
    ), stderr
    # What is said of the folder is true.
    run = tmp_path / "run"
    assert (f"`bricksrl resume {run}`" in stderr) == run.exists(), stderr
    assert ("nothing was saved" in stderr) != run.exists(), stderr
