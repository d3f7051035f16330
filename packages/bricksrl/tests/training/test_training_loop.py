from __future__ import annotations

import csv
import errno
import itertools
import json
import math
import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase
from toys import Cart, assert_equal

from brickhub.files import TEMPORARY_PREFIX
from bricksrl.agents.learner import Learner
from bricksrl.agents.sac import SACSettings
from bricksrl.errors import (
    CheckpointError,
    DivergedError,
    HubTimeoutError,
    RunError,
    UnknownNameError,
    WriteError,
)
from bricksrl.training import (
    Callback,
    Episode,
    Phase,
    Progress,
    RunFolder,
    RunResult,
    TrainConfig,
    resume,
    train,
)
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint

SMALL = SACSettings(
    hidden=(8,), batch_size=8, prefill_episodes=2, alpha_init=0.1, updates_per_step=0.25
)


@pytest.fixture
def config(tmp_path: Path) -> TrainConfig:
    return TrainConfig(env="Cart", episodes=6, seed=4, settings=SMALL, run_dir=tmp_path / "run")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of `config` from its start to its end."""
    run_dir = tmp_path_factory.mktemp("whole") / "run"
    train(TrainConfig(env="Cart", episodes=6, seed=4, settings=SMALL, run_dir=run_dir), env=Cart())
    return run_dir


def rows(path: Path) -> list[dict[str, str]]:
    with (path / "metrics.csv").open(newline="") as file:
        return [
            {name: value for name, value in row.items() if name != "seconds"}
            for row in csv.DictReader(file)
        ]


def names(path: Path) -> list[str]:
    return sorted(entry.name for entry in path.iterdir())


def test_metrics_with_a_new_measure_leave_files_that_are_being_written(config: TrainConfig) -> None:
    """A learner in another process writes its checkpoint meanwhile."""
    folder = RunFolder(train(config, env=Cart()).run_dir)
    being_written = folder.path / f"{TEMPORARY_PREFIX}best.bin"
    being_written.touch()
    before = folder.read_episodes()
    folder.append(replace(before[-1], episode=7, measures={"final_error_mm": 3.0}))
    assert being_written.exists()
    assert folder.read_episodes()[:-1] == before and folder.read_episodes()[-1].measures == {
        "final_error_mm": 3.0
    }


def assert_same_run(one: Path, other: Path) -> None:
    """Equal except for times."""
    assert rows(one) == rows(other)
    a, b = (load_checkpoint(path / "checkpoint.bin") for path in (one, other))
    for state in (a, b):
        for episode in state["episodes"]:
            del episode["seconds"]
    assert_equal(a, b)


class Recorder(Callback):
    """Records calls, and runs a function at one step."""

    def __init__(
        self, at: tuple[int, int] | None = None, do: Callable[[], object] = lambda: None
    ) -> None:
        self.calls: list[str] = []
        self.episodes: list[tuple[Episode, Progress]] = []
        self._at, self._do = at, do

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        self.calls.append(f"start {episodes_done}")

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        self.calls.append(f"step {episode}.{step} {phase}")
        if (episode, step) == self._at:
            self._do()

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self.calls.append(f"episode {episode.episode}")
        self.episodes.append((episode, progress))

    def on_end(self, result: RunResult) -> None:
        self.calls.append("end")


def ctrl_c() -> None:
    signal.raise_signal(signal.SIGINT)


def test_run_writes_files(config: TrainConfig) -> None:
    observer = Recorder()
    result = train(config, observer, env=Cart())
    assert not result.interrupted
    assert len(result.episodes) == 6
    folder = RunFolder(result.run_dir)
    assert names(result.run_dir) == [
        ".lock",
        "checkpoint.bin",
        "config.json",
        "data",
        "learning_curve.png",
        "metrics.csv",
    ]
    assert folder.read_config() == config
    assert "torchrl" in json.loads(folder.config_path.read_text())["versions"]
    episode = "episode,phase,steps,length,return,success"
    learned = "loss_qvalue,loss_actor,loss_alpha,alpha,entropy,seconds,updates_per_step"
    columns = folder.metrics_path.read_text().splitlines()[0]
    assert columns == f"{episode},{learned},link_lost,evaluation,robot"
    assert [episode.return_ for episode in folder.read_episodes()] == [
        episode.return_ for episode in result.episodes
    ]
    assert [episode.phase for episode in result.episodes] == [Phase.PREFILL] * 2 + [Phase.TRAIN] * 4
    assert not result.episodes[1].measures
    assert set(result.episodes[2].measures) == {
        "loss_qvalue",
        "loss_actor",
        "loss_alpha",
        "entropy",
        "alpha",
    }
    assert sum(episode.length for episode in result.episodes) == result.episodes[-1].steps
    assert folder.curve_path.read_bytes().startswith(b"\x89PNG")
    assert (observer.calls[0], observer.calls[1], observer.calls[-1]) == (
        "start 0",
        "step 1.1 prefill",
        "end",
    )
    assert [call for call in observer.calls if call.startswith("episode")] == [
        f"episode {k}" for k in range(1, 7)
    ]
    assert observer.episodes[-1][1].remaining_s == 0.0
    assert observer.episodes[2][1].remaining_s > 0.0
    assert all(progress.steps_per_s > 0.0 for _, progress in observer.episodes)


def test_diverged_agent_is_told(config: TrainConfig) -> None:
    class Diverging(Callback):
        def on_learner(self, learner: Learner) -> None:
            self.learner = learner

        def on_episode(self, episode: Episode, progress: Progress) -> None:
            if episode.episode == 3:
                for parameter in self.learner.policy.parameters():
                    parameter.data.fill_(math.nan)

    with pytest.raises(DivergedError, match="smaller learning_rate"):
        train(config, Diverging(), env=Cart())


def test_run_has_one_writer(config: TrainConfig) -> None:
    errors: list[str] = []

    def interfere() -> None:
        with pytest.raises(RunError) as caught:
            resume(config.run_dir, env=Cart(), episodes=9)
        errors.append(str(caught.value))

    train(config, Recorder((3, 2), interfere), env=Cart())
    resume(config.run_dir, Recorder((8, 2), interfere), env=Cart(), episodes=8)
    said = (
        f"another program writes into {config.run_dir} at this moment; wait for its end or "
        "choose another folder"
    )
    assert errors == [said, said]
    assert [row["episode"] for row in rows(config.run_dir)] == [
        str(number) for number in range(1, 9)
    ]


class Listener(Callback):
    """Keeps every transition."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int, Phase, TensorDictBase]] = []

    def on_transition(
        self, episode: int, step: int, phase: Phase, transition: TensorDictBase
    ) -> None:
        self.seen.append((episode, step, phase, transition.clone()))


def test_callback_receives_every_transition(config: TrainConfig) -> None:
    listener = Listener()
    result = train(config, listener, env=Cart())
    for episode in result.episodes:
        steps = [
            (step, data)
            for number, step, phase, data in listener.seen
            if (number, phase) == (episode.episode, episode.phase)
        ]
        assert [step for step, _ in steps] == list(range(1, episode.length + 1))
        outcomes = [data["next"] for _, data in steps]
        assert sum(outcome["reward"].item() for outcome in outcomes) == pytest.approx(
            episode.return_, abs=1e-5
        )
        assert [outcome["done"].item() for outcome in outcomes] == [False] * (
            episode.length - 1
        ) + [True]
        for (_, one), (_, other) in itertools.pairwise(steps):
            assert torch.equal(one["next", "observation"], other["observation"])
        last = outcomes[-1]
        assert last["truncated"].item() == (episode.length == 8) or last["terminated"].item()


def test_only_equal_seeds_give_equal_runs(config: TrainConfig, whole: Path, tmp_path: Path) -> None:
    torch.rand(7)  # whatever happened before must not matter
    train(replace(config, run_dir=tmp_path / "again"), env=Cart())
    assert_same_run(whole, tmp_path / "again")
    train(replace(config, run_dir=tmp_path / "other", seed=5), env=Cart())
    assert rows(whole) != rows(tmp_path / "other")


def test_training_restores_torch_state(config: TrainConfig) -> None:
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    train(config, env=Cart())
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), state)


@pytest.mark.parametrize("at", [(1, 1), (2, 8), (3, 1), (4, 2), (6, 2)])
def test_interrupted_and_resumed_run_ends_bit_identical(
    config: TrainConfig, whole: Path, at: tuple[int, int]
) -> None:
    result = train(config, Recorder(at, ctrl_c), env=Cart())
    assert result.interrupted
    assert len(result.episodes) == len(rows(result.run_dir)) == at[0] - (at[1] < 8)
    assert (result.run_dir / "learning_curve.png").exists()
    observer = Recorder()
    assert not resume(result.run_dir, observer, env=Cart()).interrupted
    assert observer.calls[0] == f"start {len(result.episodes)}"
    assert_same_run(whole, result.run_dir)


def test_a_finished_run_can_be_extended(config: TrainConfig, whole: Path, tmp_path: Path) -> None:
    train(replace(config, episodes=3), env=Cart())
    assert len(resume(tmp_path / "run", episodes=6, env=Cart()).episodes) == 6
    assert_same_run(whole, tmp_path / "run")
    assert RunFolder(tmp_path / "run").read_config() == config
    again = resume(tmp_path / "run", env=Cart())
    assert not again.interrupted
    assert_same_run(whole, tmp_path / "run")
    with pytest.raises(
        RunError, match="is meant to have 6 episodes; give that number or more, not 5"
    ):
        resume(tmp_path / "run", episodes=5, env=Cart())


def test_another_thread_can_stop_a_run(config: TrainConfig) -> None:
    stop = threading.Event()
    results: list[RunResult] = []

    def work() -> None:
        results.append(train(config, Recorder((4, 2), stop.set), env=Cart(), stop=stop))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join(60)
    assert results[0].interrupted
    assert len(results[0].episodes) == 3


class CartInHand(Cart):
    """Its second reset waits for ever."""

    def _reset(self, *args: object, **kwargs: object) -> object:  # type: ignore[override]
        if self.resets == 1:
            threading.Timer(0.2, ctrl_c).start()
            threading.Event().wait(30)
        return super()._reset()


def test_ctrl_c_ends_waiting_reset(config: TrainConfig, whole: Path) -> None:
    result = train(config, env=CartInHand())
    assert result.interrupted
    assert len(result.episodes) == 1
    resume(result.run_dir, env=Cart())
    assert_same_run(whole, result.run_dir)


def test_second_ctrl_c_does_not_wait_for_the_step(config: TrainConfig) -> None:
    def twice() -> None:
        ctrl_c()
        ctrl_c()

    result = train(config, Recorder((4, 2), twice), env=Cart())
    assert result.interrupted
    assert len(result.episodes) == 3
    assert (result.updates_per_step, result.caught_up) == (None, 0), "nothing is said of a part"


class BrokenCart(Cart):
    """Raises in its fourth episode without reporting a lost link."""

    def _step(self, tensordict: object) -> object:  # type: ignore[override]
        if self.resets == 4:
            raise HubTimeoutError("the hub did not answer; switch it on")
        return super()._step(tensordict)  # type: ignore[arg-type]


def test_environment_error_keeps_progress(config: TrainConfig, whole: Path, tmp_path: Path) -> None:
    with pytest.raises(HubTimeoutError):
        train(config, env=BrokenCart())
    assert len(rows(tmp_path / "run")) == 3
    assert (tmp_path / "run" / "learning_curve.png").exists()
    resume(tmp_path / "run", env=Cart())
    assert_same_run(whole, tmp_path / "run")


def test_metrics_row_after_checkpoint_is_dropped(
    config: TrainConfig, whole: Path, tmp_path: Path
) -> None:
    train(replace(config, episodes=3), env=Cart())
    folder = RunFolder(tmp_path / "run")
    folder.append(replace(folder.read_episodes()[-1], episode=4))
    resume(folder.path, episodes=6, env=Cart())
    assert_same_run(whole, tmp_path / "run")


def test_metrics_row_that_a_crash_cut_is_not_read(config: TrainConfig, tmp_path: Path) -> None:
    result = train(replace(config, episodes=3), env=Cart())
    folder = RunFolder(tmp_path / "run")
    folder.metrics_path.write_bytes(folder.metrics_path.read_bytes()[:-9])
    assert [episode.return_ for episode in folder.read_episodes()] == [
        episode.return_ for episode in result.episodes[:2]
    ]


def test_run_folder_is_never_overwritten(config: TrainConfig) -> None:
    assert config.run_dir is not None
    config.run_dir.mkdir()
    env = Cart()
    with pytest.raises(RunError, match="exists already; resume"):
        train(config, env=env)
    assert env.resets == 0
    assert names(config.run_dir) == []


def test_metrics_that_a_spreadsheet_has_open_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Windows, where nobody else can write them then."""
    folder = RunFolder(tmp_path)
    episode = Episode(1, Phase.TRAIN, 10, 10, 13.3, None)
    folder.write_episodes([episode])
    opened = Path.open

    def refusing(path: Path, mode: str = "r", *rest: object, **options: object) -> object:
        if "+" in mode:
            raise PermissionError(errno.EACCES, "Permission denied")
        return opened(path, mode, *rest, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "open", refusing)
    monkeypatch.setattr("sys.platform", "win32")
    with pytest.raises(WriteError, match=r"cannot write .*metrics\.csv .*; close the program that"):
        folder.append(episode)
    assert folder.read_episodes() == (episode,)


def test_run_folder_that_cannot_be_written_is_told(config: TrainConfig, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WriteError, match="cannot write .*file/run .*; name another place"):
        train(replace(config, run_dir=tmp_path / "file" / "run"), env=Cart())


def test_default_run_folder_is_next_free(
    config: TrainConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in (f"Cart-sac-seed-{config.seed}", f"Cart-sac-seed-{config.seed}-2"):
        assert (
            train(replace(config, run_dir=None, episodes=1), env=Cart()).run_dir
            == Path("runs") / name
        )


def test_unknown_names_leave_no_folder(config: TrainConfig, tmp_path: Path) -> None:
    for wrong in (
        replace(config, env="RunAwya-v0"),
        replace(config, agent="pop"),
        replace(config, env="RunAway-v0", hub="wifi"),
    ):
        with pytest.raises(UnknownNameError):
            train(wrong)
    assert names(tmp_path) == []


def test_resume_of_other_run_raises(config: TrainConfig, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no run in"):
        resume(tmp_path, env=Cart())
    train(replace(config, episodes=2), env=Cart())
    checkpoint = tmp_path / "run" / "checkpoint.bin"
    state = load_checkpoint(checkpoint)
    save_checkpoint(checkpoint, {**state, "identity": {**state["identity"], "seed": 77}})
    with pytest.raises(CheckpointError, match="belongs to another config"):
        resume(str(tmp_path / "run"), env=Cart())
    checkpoint.write_bytes(b"PK\x03\x04")
    with pytest.raises(CheckpointError, match="not a checkpoint of this version"):
        resume(tmp_path / "run", env=Cart())
    for text in ("{", "[]", '{"bricksrl_run": 2, "config": {}}'):
        (tmp_path / "run" / "config.json").write_text(text)
        with pytest.raises(RunError, match=r"config\.json"):
            resume(tmp_path / "run", env=Cart())


def test_random_agent_runs_too(config: TrainConfig) -> None:
    result = train(replace(config, agent="random", settings=None), env=Cart())
    assert [episode.phase for episode in result.episodes] == [Phase.TRAIN] * 6
    assert not result.episodes[-1].measures


def test_learns_to_leave_the_wall(config: TrainConfig) -> None:
    settings = SACSettings(hidden=(16,), batch_size=16, learning_rate=3e-3)
    result = train(replace(config, episodes=18, settings=settings), env=Cart())
    assert sum(episode.return_ for episode in result.episodes[-5:]) / 5 > 5.0
