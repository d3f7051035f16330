"""Runs killed by SIGKILL at seeded random moments."""

from __future__ import annotations

import os
import random
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from test_training_loop import assert_same_run

from brickhub.files import TEMPORARY_PREFIX
from bricksrl.agents import preset
from bricksrl.training import RunFolder, TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint

EPISODES = 30
SETTINGS = ("--set", "hidden=16", "--set", "batch_size=16", "--set", "updates_per_step=1")


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "bricksrl", *arguments]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, env={**os.environ, "MUJOCO_GL": "disable"}, stdout=pipe, stderr=pipe, text=True
    )


def kill_in(process: subprocess.Popen[str], episode: int, delay_s: float) -> int:
    """Kill the process some time after an episode. Returns the last reported episode."""
    assert process.stdout is not None
    told = 0
    for line in process.stdout:
        if found := re.match(r"episode (\d+)/", line):
            told = int(found[1])
            if told >= episode:
                break
    time.sleep(delay_s)
    process.kill()
    rest, stderr = process.communicate(timeout=60)  # ends when nobody holds the pipes any more
    # multiprocessing's resource tracker tells of semaphores that TorchRL's replay buffers held
    said = [line for line in stderr.splitlines() if "resource_tracker" not in line]
    assert (process.returncode, said) == (-9, [])
    return max(
        [told, *(int(number) for number in re.findall(r"^episode (\d+)/", rest, re.MULTILINE))]
    )


@pytest.mark.slow
def test_repeatedly_killed_run_equals_uninterrupted(tmp_path: Path) -> None:
    rng = random.Random(7)
    settings = replace(preset("default", "sac"), hidden=(16,), batch_size=16, updates_per_step=1.0)
    config = TrainConfig(
        "RoboArmSim-v0", episodes=EPISODES, seed=5, settings=settings, run_dir=tmp_path / "whole"
    )
    train(config)
    run_dir = tmp_path / "run"
    new = (
        "train",
        "RoboArmSim-v0",
        "--episodes",
        str(EPISODES),
        "--seed",
        "5",
        *SETTINGS,
        "--run",
        str(run_dir),
    )
    saved = 0
    for arguments in (new, ("resume", str(run_dir)), ("train", "--resume", str(run_dir))):
        told = kill_in(start(*arguments), saved + rng.randint(2, 7), rng.uniform(0.0, 0.1))
        saved = len(load_checkpoint(run_dir / "checkpoint.bin")["episodes"])
        assert told <= saved <= told + 2, "what was told of is on the disk"
    assert saved < EPISODES
    resume(run_dir)
    assert_same_run(tmp_path / "whole", run_dir)
    assert not list(run_dir.glob(f"{TEMPORARY_PREFIX}*")), "nothing half written is left"


@pytest.mark.slow
def test_learner_of_killed_run_saves_and_exits(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    child = start(
        "train",
        "RoboArmSim-v0",
        "--episodes",
        "500",
        *SETTINGS,
        "--run",
        str(run_dir),
        "--asynchronous",
    )
    told = kill_in(child, 3, 0.05)  # it waits until the learner has gone too
    assert len(load_checkpoint(run_dir / "checkpoint.bin")["episodes"]) >= told
    assert len(RunFolder(run_dir).read_episodes()) >= told
