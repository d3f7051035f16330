from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import torch
from tensordict import TensorDictBase
from toys import Cart
from videos import read_video

from brickhub.hub.interface import Interface, Wait
from bricksrl import make, register
from bricksrl.agents.sac import SACSettings
from bricksrl.cli.evaluate import describe
from bricksrl.envs import get_task, registry
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.rollout import play_episodes
from bricksrl.envs.task import Entry
from bricksrl.errors import CheckpointError, DescriptionError, RenderingUnavailableError, RunError
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.comparison import compare
from bricksrl.evaluation.evaluator import MAX_COPIES
from bricksrl.evaluation.film import film_run, filmed_env, side_by_side
from bricksrl.evaluation.statistics import wilson_interval
from bricksrl.policies.sharing import export_policy
from bricksrl.training import RunFolder, TrainConfig, train
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import VideoWriter


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = SACSettings(
        hidden=(16,), batch_size=16, learning_rate=1e-2, updates_per_step=2, prefill_episodes=2
    )
    config = TrainConfig(
        env="Cart", episodes=10, settings=settings, run_dir=tmp_path_factory.mktemp("runs") / "cart"
    )
    return train(config, env=Cart()).run_dir


@pytest.fixture(scope="module")
def spins() -> Iterator[str]:
    """Spinning-v0 in episodes of a few steps."""
    register(replace(get_task("Spinning-v0"), id="Spins-v0", max_steps=6))
    yield "Spins-v0"
    del registry._specs["Spins-v0"]


@pytest.fixture(scope="module")
def spinning(spins: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on a robot with a flat battery."""
    settings, folder = (
        SACSettings(hidden=(8,), batch_size=8),
        tmp_path_factory.mktemp("spinning") / "run",
    )
    physics = Physics(battery_v=6.4)
    return train(
        TrainConfig(
            spins,
            episodes=1,
            settings=settings,
            physics=physics,
            record=False,
            run_dir=folder,
        )
    ).run_dir


NOTHING = Interface((), (), Wait(1))


@dataclass(frozen=True)
class Task:
    """A minimal task: the cart has to pass 600 mm."""

    id: str = "Judged-v0"
    entries: tuple[Entry, ...] = (
        Entry("x", 0.0, 1000.0, "mm", (0.0, 1000.0)),
        Entry("noise", -1.0, 1.0, "", (-1.0, 1.0)),
    )
    interface: Interface = NOTHING
    symmetric: bool = False

    def success(self, observations: torch.Tensor) -> torch.Tensor:
        return observations[-1, 0] > 600.0

    def metrics(self, observations: torch.Tensor) -> dict[str, torch.Tensor]:
        return {"final_position_mm": observations[-1, 0]}


def test_evaluation_result_is_consistent_and_saved(run_dir: Path) -> None:
    heard: list[tuple[int, float]] = []
    result = evaluate(
        run_dir,
        Cart(),
        episodes=6,
        on_episode=lambda episode, return_: heard.append((episode, return_)),
    )
    assert result.episodes == len(result.returns) == len(result.lengths) == 6
    assert result.trained_episodes == 10
    assert result.return_mean == pytest.approx(sum(result.returns) / 6)
    assert result.return_std == pytest.approx(
        math.sqrt(sum((r - result.return_mean) ** 2 for r in result.returns) / 6)
    )
    assert result.return_interval is not None
    assert result.return_interval.low <= result.return_mean <= result.return_interval.high
    assert result.return_mean > 5.0
    assert result.success_rate is None
    assert result.as_trained
    assert heard == list(enumerate(result.returns, 1))
    data = json.loads(result.to_json())
    assert json.loads((run_dir / "evaluation.json").read_text()) == data
    assert data["returns"] == list(result.returns)
    assert "\n" not in result.to_json()


def test_successes_and_metrics_are_counted(run_dir: Path) -> None:
    class Judged(BricksEnv, Cart):
        task = cast("Any", Task())

    env = Judged()
    result = evaluate(run_dir, env, episodes=4)
    assert result.env == "Judged-v0" and not result.as_trained
    assert result.success_rate == 1.0
    assert result.success_interval == wilson_interval(4, 4)
    assert 600.0 < result.metrics["final_position_mm"] <= 1000.0


def test_other_environment_gets_the_options_of_the_training_that_it_has(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    task = "from dataclasses import replace\nfrom bricksrl.envs import get_task\n"
    (tmp_path / "own.py").write_text(
        f"{task}TASK = replace(get_task('Walker-v0'), id='Own-v0', max_steps=2)\n"
    )
    steps = {"step_ms": 400, "blocked_at_mm": 50.0}
    config = TrainConfig(
        "WalkerSim-v1", "random", episodes=1, run_dir=tmp_path / "run", options=steps
    )
    run_dir, settled = train(config).run_dir, []

    def time_of_step(env: Any) -> None:
        settled.append(env.task.interface.settle)

    for options in ({}, {"step_ms": 300}):
        evaluate(run_dir, "WalkerSim-v0", episodes=1, save=False, on_env=time_of_step, **options)
    assert settled == [Wait(400), Wait(300)] and not caplog.messages
    evaluate(run_dir, str(tmp_path / "own.py"), episodes=1, save=False, on_env=time_of_step)
    assert settled[2] == Wait(250)
    without = "has no step_ms, blocked_at_mm, which the training had; it is evaluated without"
    assert caplog.messages == [f"{tmp_path / 'own.py'} {without}"]


def test_evaluation_is_reproducible_by_seed(run_dir: Path) -> None:
    first = evaluate(run_dir, Cart(), episodes=2, seed=1)
    assert evaluate(run_dir, Cart(), episodes=2, seed=1) == first
    assert evaluate(run_dir, Cart(), episodes=3, seed=1).returns[:2] == first.returns
    assert evaluate(run_dir, Cart(), episodes=2, seed=2).returns != first.returns


def test_evaluation_writes_only_its_file(run_dir: Path) -> None:
    (run_dir / "evaluation.json").unlink(missing_ok=True)
    before = {path: path.read_bytes() for path in run_dir.rglob("*") if path.is_file()}
    state = torch.get_rng_state()
    evaluate(run_dir, Cart(), episodes=1, save=False)
    assert {path: path.read_bytes() for path in run_dir.rglob("*") if path.is_file()} == before
    assert torch.equal(torch.get_rng_state(), state)


def test_mismatched_environment_raises(run_dir: Path) -> None:
    class Wider(Cart):
        def __init__(self) -> None:
            super().__init__()
            self.observation_spec["observation"].space.high.mul_(2.0)

    with pytest.raises(
        CheckpointError,
        match="learned in Cart; choose an environment with its observations and actions",
    ):
        evaluate(run_dir, Wider())


def test_missing_run_or_no_episodes_raise(run_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no run in"):
        evaluate(tmp_path)
    with pytest.raises(DescriptionError, match="give 1 or more"):
        evaluate(run_dir, Cart(), episodes=0)


class PausedCart(BricksEnv, Cart):
    """Paused in its second episode, which ends after three steps."""

    @property
    def is_cut(self) -> bool:
        return self.resets == 2 and self.step_count >= 3

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        out = super()._step(tensordict)
        return out.update(
            {"truncated": out["truncated"] | self.is_cut, "done": out["done"] | self.is_cut}
        )


def test_paused_episode_is_not_counted(run_dir: Path) -> None:
    env, seen = PausedCart(), []
    paused = evaluate(run_dir, env, episodes=3, save=False, on_env=seen.append)
    assert env.resets == 4 and seen == [env]
    assert paused.returns == evaluate(run_dir, Cart(), episodes=3, save=False).returns, (
        "it was made again, from the same start"
    )


def test_few_episodes_have_no_interval(run_dir: Path) -> None:
    result = evaluate(str(run_dir), Cart(), episodes=4, save=False)
    assert result.return_interval is None
    assert "interval of the mean" not in "\n".join(describe(result))


def test_only_an_evaluation_under_the_conditions_of_the_training_counts(
    spinning: Path, spins: str
) -> None:
    for changes in ({"physics": Physics()}, {"randomize": True}):
        assert not evaluate(spinning, episodes=1, **changes).as_trained
        assert compare([spinning]).scored_by != "evaluation"
        assert (
            "not been evaluated"
            in (export_policy(spinning, spinning / next(iter(changes))) / "README.md").read_text()
        )
    with closing(make(spins, seed=0)) as env:
        assert evaluate(spinning, env, episodes=1).as_trained, (
            "the caller's, whose physics are not compared"
        )
        env.task = replace(env.task, id="Turning-v0")
        assert not evaluate(spinning, env, episodes=1).as_trained
    assert evaluate(spinning, episodes=1, physics=Physics(battery_v=6.4)).as_trained
    assert evaluate(spinning, episodes=1).as_trained
    assert compare([spinning]).scored_by == "evaluation"
    assert (
        "in 1 episode of evaluation"
        in (export_policy(spinning, spinning / "policy") / "README.md").read_text()
    )


def test_film_shows_the_evaluated_episodes(spinning: Path, tmp_path: Path) -> None:
    path, small, seen = tmp_path / "film.mp4", {"size": (64, 48), "budget_s": 0.2}, []
    for changes in (
        {},
        {"physics": Physics(friction_scale=0.1, slope_deg=10.0)},
        {"randomize": True},
    ):
        with ExitStack() as films:
            on_env = partial(
                lambda films, env: films.enter_context(filmed_env(env, path, "spins", **small)),
                films,
            )
            try:
                seen.append(
                    evaluate(spinning, episodes=1, save=False, on_env=on_env, **changes).returns
                )
            except RenderingUnavailableError as error:
                pytest.skip(str(error))
        assert path.stat().st_size > 0
        path.unlink()
    assert len(set(seen)) == 3
    assert evaluate(spinning, episodes=1, save=False).returns == seen[0], "to film changes nothing"
    assert film_run(spinning, "last", path, "spins", **small).return_ == pytest.approx(seen[0][0])


def test_films_in_a_folder_of_any_name_are_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A colon does not end the name of a protocol."""
    monkeypatch.chdir(tmp_path)
    films = [Path(f"C:\\läufe 1/{name}.mp4") for name in ("before", "after", "both")]
    for film in films[:2]:
        with VideoWriter(film, 10) as video:
            video.add(np.zeros((32, 32, 3), np.uint8))
    assert read_video(side_by_side(*films)).shape == (1, 540, 1080, 3)


def test_film_ends_with_the_return_of_the_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    def captioned(image: Any, title: str, text: str, marks: Any) -> Any:
        shown.append(text)
        return image

    monkeypatch.setattr("bricksrl.evaluation.film.captioned", captioned)
    with closing(make("RunAway-v0", seed=0)) as env:
        try:
            with filmed_env(env, tmp_path / "film.mp4", "runs", size=(64, 48), budget_s=0.2):
                scores = list(
                    play_episodes(env, lambda state: state.set("action", torch.ones(1)), 2, 0)
                )
        except RenderingUnavailableError as error:
            pytest.skip(str(error))
    last = {text.split("   ")[0]: text for text in shown}
    for number, score in enumerate(scores, 1):
        assert f"step {score.length}   " in last[f"episode {number}"]
        assert f"return {score.return_:.1f}" in last[f"episode {number}"]


@pytest.mark.parametrize(("named", "copies"), [({}, 3), ({"frame_skip": 2}, 1)])
def test_simulation_is_evaluated_in_as_many_copies_as_episodes(
    tmp_path: Path, named: dict[str, Any], copies: int
) -> None:
    """One after the other behind transforms, which may have a memory."""
    run = RunFolder.create(
        TrainConfig("WalkerSim-v0", "random", episodes=1, run_dir=tmp_path / "run"), {}
    )
    seen: list[Any] = []

    def stop(env: Any) -> None:
        seen.append(env.batch_size.numel())
        raise InterruptedError

    with pytest.raises(InterruptedError):
        evaluate(run.path, episodes=3, on_env=stop, **named)
    assert seen == [copies]


def test_many_episodes_are_evaluated_in_rounds_of_copies(tmp_path: Path) -> None:
    run = RunFolder.create(
        TrainConfig("WalkerSim-v0", "random", episodes=1, run_dir=tmp_path / "run"), {}
    )
    seen: list[int] = []

    def stop(env: Any) -> None:
        seen.append(env.batch_size.numel())
        raise InterruptedError

    with pytest.raises(InterruptedError):
        evaluate(run.path, episodes=2000, on_env=stop)
    assert seen == [MAX_COPIES]
