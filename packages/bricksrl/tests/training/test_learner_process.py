"""Asynchronous learning, in a process of its own."""

from __future__ import annotations

import contextlib
import os
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch
from forked import ForkServer, Scratch
from tensordict import TensorDict
from test_training_loop import Recorder, ctrl_c, rows
from toys import Cart

from bricksrl import child_process, make
from bricksrl.agents import make_learner
from bricksrl.agents.learner import Learner
from bricksrl.agents.sac import SACSettings
from bricksrl.envs.env import HubEnv
from bricksrl.errors import LearnerError
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.learner_side import AsyncLearner, LearningPace

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("forked_children")]

SMALL = SACSettings(hidden=(16, 16), batch_size=16, prefill_episodes=2, updates_per_step=2)
SEEN = torch.tensor([300.0, 0.5])


@pytest.fixture
def config(tmp_path: Path) -> TrainConfig:
    return TrainConfig(
        "Cart", episodes=6, seed=4, settings=SMALL, run_dir=tmp_path / "run", asynchronous=True
    )


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """Learner processes that were started."""
    processes = []
    popen = child_process.subprocess.Popen

    def note(*args, **kwargs):
        processes.append(popen(*args, **kwargs))
        return processes[-1]

    monkeypatch.setattr(child_process.subprocess, "Popen", note)
    return processes


@contextlib.contextmanager
# it is frozen
def learner(
    *,
    patient: bool = False,
    pace: LearningPace = LearningPace(),  # noqa: B008
) -> Iterator[AsyncLearner]:
    torch.manual_seed(0)
    acting, config = (
        make_learner("sac", Cart(), SMALL),
        TrainConfig("Cart", settings=SMALL, realtime=not patient),
    )
    state = {"agent": acting.state_dict(), "pace": asdict(pace), "collected": [], "transforms": {}}
    with AsyncLearner(config, Cart(), acting, state) as found:
        yield found


def best_action(side: AsyncLearner) -> torch.Tensor:
    return side.actor.exploit(TensorDict({"observation": SEEN}))["action"]


def remember(side: AsyncLearner, count: int) -> None:
    flag = torch.zeros(1, dtype=torch.bool)
    after = {
        "observation": SEEN,
        "reward": torch.ones(1),
        "terminated": flag,
        "truncated": flag,
        "done": flag,
    }
    frame = TensorDict(
        {"observation": SEEN, "action": torch.tensor([0.5]), "next": TensorDict(after)}
    )
    for _ in range(count):
        side.remember(frame[None])


def test_learner_never_leads_robot(tmp_path: Path) -> None:
    with learner() as side:
        side.wait_until_ready()
        before = best_action(side)
        remember(side, 30)
        started_s = time.perf_counter()
        for _ in range(200):
            side.learn(1)
            assert side.pace.done <= side.pace.asked
        asked_s = time.perf_counter() - started_s
        assert side.pace == LearningPace(200, side.pace.done)
        side.finish(lambda: True)
        assert side.pace == LearningPace(200, 200)
        assert asked_s < 0.5 * (time.perf_counter() - started_s), "asking waits for no gradient"
        losses = side.learn(1)
        assert losses["loss_qvalue"] > 0
        side.finish(lambda: True)
        side.save(tmp_path / "checkpoint", {"more": 1})
        side.finish(lambda: True)
        after = best_action(side)
        assert not torch.equal(before, after), "weights have come back"
        state = load_checkpoint(tmp_path / "checkpoint")
        assert (state["more"], state["pace"]) == (1, {"asked": 201, "done": 201})
        saved = make_learner("sac", Cart(), SMALL)
        saved.load_state_dict(state["agent"])
        assert torch.equal(saved.exploit(TensorDict({"observation": SEEN}))["action"], after)
        assert len(state["agent"]["memory"]["rows"]["action"]) == 30


def test_pending_updates_are_made_after_resume() -> None:
    with learner(patient=True, pace=LearningPace(30, 10)) as side:
        remember(side, 30)
        side.learn(1)
        assert side.pace.done >= 31 - 4


def test_asynchronous_run_saves_learner(config: TrainConfig) -> None:
    result = train(config, env=Cart())
    assert (len(result.episodes), result.interrupted) == (6, False)
    asked = sum(episode.length for episode in result.episodes[2:])
    assert result.updates_per_step == pytest.approx(2 * (asked - result.caught_up / 2) / asked)
    assert [row["updates_per_step"] for row in rows(result.run_dir)][:2] == ["", ""]
    assert 0 < float(rows(result.run_dir)[-1]["updates_per_step"]) <= result.updates_per_step + 1e-3
    assert result.episodes[-1].measures["loss_qvalue"] > 0
    state = load_checkpoint(result.run_dir / "checkpoint.bin")
    assert len(state["agent"]["memory"]["rows"]["action"]) == result.episodes[-1].steps
    assert state["pace"] == {"asked": asked, "done": asked}
    more = resume(result.run_dir, episodes=8, env=Cart())
    assert [episode.episode for episode in more.episodes] == list(range(1, 9))
    state = load_checkpoint(result.run_dir / "checkpoint.bin")
    assert len(state["agent"]["memory"]["rows"]["action"]) == more.episodes[-1].steps
    assert state["pace"]["done"] == asked + sum(episode.length for episode in more.episodes[6:])


def test_killed_learner_ends_run_with_one_error(
    config: TrainConfig, started, tmp_path: Path
) -> None:
    observer = Recorder((4, 1), lambda: [process.kill() for process in started])
    with pytest.raises(LearnerError, match=r"died \((signal 9|exit code 1)\); resume") as caught:
        train(replace(config, episodes=10_000), observer, env=Cart())
    assert "\n" not in str(caught.value)
    assert observer.episodes[-1][0].episode < 100
    saved = len(load_checkpoint(tmp_path / "run" / "checkpoint.bin")["episodes"])
    result = resume(tmp_path / "run", Recorder((saved + 2, 1), ctrl_c), env=Cart())
    assert (len(result.episodes), result.interrupted) == (len(rows(tmp_path / "run")), True)
    assert started[1].wait(10) == 0, "an interrupted run leaves no process behind"


def test_motors_stop_when_learner_dies(started, tmp_path: Path, monkeypatch) -> None:
    config = TrainConfig("RunAway-v0", settings=SMALL, run_dir=tmp_path / "run", asynchronous=True)
    env = make("RunAway-v0", seed=0)
    assert isinstance(env, HubEnv)
    monkeypatch.setattr("bricksrl.training.run.make", lambda *_, **__: env)
    twins = []

    def kill() -> None:
        twins.append(env.twin)
        started[0].kill()

    with pytest.raises(LearnerError, match="died"):
        train(config, Recorder((1, 3), kill))
    body, machine = twins[0].body, twins[0].machine
    machine.advance(1000)  # coasting comes to rest
    angles_mdeg = [body.angle_mdeg(port) for port in ("A", "E")]
    machine.advance(1000)
    assert [body.angle_mdeg(port) for port in ("A", "E")] == pytest.approx(angles_mdeg, abs=50)


def test_learner_error_is_one_line(config: TrainConfig, tmp_path: Path) -> None:
    env = make("RunAway-v0", seed=0)
    with pytest.raises(
        LearnerError, match=r"failed \(UnknownNameError: there is no environment 'Nowhere-v7'"
    ) as caught:
        train(replace(config, env="Nowhere-v7"), env=env)
    env.close()
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_during_learner_start_leaves_no_files(
    config: TrainConfig, started, tmp_path: Path
) -> None:
    class Interrupting(Recorder):
        def on_learner(self, learner: Learner) -> None:
            threading.Timer(0.03, ctrl_c).start()

    with pytest.raises(KeyboardInterrupt):
        train(config, Interrupting(), env=Cart())
    assert started[0].returncode is not None
    assert list(tmp_path.iterdir()) == []


def test_error_of_a_callback_is_the_last_line(
    processes: ForkServer | Scratch, tmp_path: Path
) -> None:
    script = (
        "from bricksrl.training import Callback, TrainConfig, train\n"
        "class Faulty(Callback):\n"
        "    def on_episode(self, episode, progress):\n"
        "        raise ValueError('mine')\n"
        "train(TrainConfig('RunAway-v0', episodes=2, asynchronous=True), Faulty())\n"
    )
    done = processes.run((), tmp_path, os.environ, 100.0, script)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (1, "ValueError: mine")
