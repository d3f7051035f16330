"""Playing on the page."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict, TensorDictBase

import bricksrl
from bricksrl.envs import get_task
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import HubError, PageError, StoppedError
from bricksrl.page.live import LivePage
from bricksrl.page.play import PageCallback, play_endlessly, play_on_page, resting_player
from bricksrl.page.program import ProgramPage
from bricksrl.policies.policy import Player, random_player
from bricksrl.training import Episode, Phase, Progress, RunResult, TrainConfig


@pytest.mark.parametrize("value", [[], {}, {"speed": []}, None, 1, "warp", ["x"] * 1000])
def test_speed_or_policy_that_does_not_exist_is_refused(value: object) -> None:
    live, program = LivePage("RunAway-v0", policies=("random", "agent")), ProgramPage("main.py")
    for page in (live, program):
        with pytest.raises(PageError, match=r"^there is no speed .{1,40}; choose 1x, 10x or max$"):
            page._press("speed", value)
        page._press("speed", "10x")
        assert page.board.status[1]["speed"] == "10x"
    with pytest.raises(PageError, match=r"^there is no policy .{1,40}; choose random or agent$"):
        live._press("policy", value)
    live._press("policy", "random")
    assert live.policy == "random"


def test_reset_pressed_before_a_stop_does_not_start_the_robot_again() -> None:
    with closing(bricksrl.make("RunAway-v0", seed=0)) as env:
        page, over = LivePage("RunAway-v0", task=env.task), threading.Event()

        def act(state):
            assert not page.is_stopped and not timers, "it moves again"
            page._press("reset", None)
            page.stop()
            timers.append(threading.Timer(1.5, over.set))
            timers[0].start()
            return state.set("action", env.action_spec.zero())

        timers: list[threading.Timer] = []
        with pytest.raises(StoppedError):
            play_on_page(env, page, {"": lambda: Player(act)}, stop=over)
        timers[0].join()


def test_page_shows_the_robots_own_steps(tmp_path: Path) -> None:
    file, shown = tmp_path / "mine.py", list[TensorDictBase]()
    file.write_text(
        "from torchrl.envs import Compose, RenameTransform, RewardScaling\n"
        "transform = Compose(RenameTransform(['observation'], ['seen']), RewardScaling(0.0, 0.1))\n"
    )
    with closing(bricksrl.make("WalkerSim-v0", seed=0, transform=str(file), frame_skip=2)) as env:
        page = LivePage("WalkerSim-v0", task=env.task, speed="max")
        page.show_step = shown.append
        returns = play_on_page(env, page, {"": lambda: random_player(env, 0)}, episodes=1)
    assert [frame["next", "observation"].shape for frame in shown] == [(7,)] * 100
    assert returns == [
        pytest.approx(sum(float(frame["next", "reward"]) for frame in shown), rel=1e-4)
    ]


def test_nothing_resets_while_a_human_drives() -> None:
    with closing(bricksrl.make("RunAway-v0", seed=0)) as env:
        page, over, steps = (
            LivePage("RunAway-v0", task=env.task, in_charge=True),
            threading.Event(),
            list[int](),
        )

        def show(_frame: object) -> None:
            steps.append(page._steps)
            if len(steps) > 2 * env.task.max_steps:
                over.set()

        page.show_step = show
        page.begin = steps.clear
        with pytest.raises(StoppedError):
            play_on_page(env, page, {"": lambda: resting_player(env)}, stop=over)
        assert len(steps) == 2 * env.task.max_steps + 1


def test_simulation_without_a_robot_is_paced(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step takes 0.1 s at the speed of real time, also after a pause, which is not made up."""
    now, naps = [100.0], list[float]()
    monkeypatch.setattr("bricksrl.page.live.time.perf_counter", lambda: now[0])
    with LivePage("WalkerSim-v0", speed="1x") as page:
        page._is_paced_here = True
        monkeypatch.setattr(page._halted, "wait", naps.append)
        for passed_s in (0.0, 0.0, 0.02, 5.0):
            now[0] += passed_s
            page.hold()
        assert naps == pytest.approx([0.0, 0.0, 0.08, 0.0])
        page._press("speed", "max")
        page.hold()
        assert len(naps) == 4, "as fast as it can"


def test_robot_that_was_stopped_is_seen_to_coast_for_half_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    naps, over = list[float](), threading.Event()

    def nap(seconds: float) -> None:
        naps.append(seconds)
        over.set()

    with closing(bricksrl.make("RunAway-v0", seed=0)) as env:
        page = LivePage("RunAway-v0", task=env.task)
        stopped_ms = list[int]()

        def episode(_number: str) -> Iterator[None]:
            env.reset()
            page.stop()
            stopped_ms.append(env.twin.machine.time_ms)
            monkeypatch.setattr("bricksrl.page.play.time.sleep", nap)
            yield

        with pytest.raises(StoppedError):
            play_endlessly(env, page, episode, stop=over)
        assert env.twin.machine.time_ms - stopped_ms[0] == pytest.approx(500, abs=5)
        assert sum(naps) == pytest.approx(0.5)
        says = "The robot was stopped by hand. Reset lets it start again."
        assert page.board.status[1]["message"] == says
        assert page.board.status[1]["state"] == "stopped"


class Toy(BricksEnv):
    """An environment that is played by a generator of its own."""

    batch_size = torch.Size()


def test_episodes_are_played_until_they_are_enough() -> None:
    page, numbers = LivePage("Toy"), list[str]()

    def episode(number: str) -> Iterator[None]:
        numbers.append(number)
        for step in range(3):
            # The second one is cut short, and does not count.
            if len(numbers) == 2 and step == 1:
                page._press("reset", None)
            yield
        return 10.0 * len(numbers)

    assert play_endlessly(Toy(), page, episode, episodes=2) == [10.0, 30.0]
    assert numbers == ["1", "2", "2"]
    assert list(page.board.series["return"].rows) == [(10.0,), (30.0,)]
    assert page.board.status[1]["facts"]["episode"] == "2"


def test_lost_robot_is_tried_again_after_a_reset(monkeypatch: pytest.MonkeyPatch) -> None:
    page, messages, tries = LivePage("Toy"), list[str](), list[str]()

    def episode(number: str) -> Iterator[None]:
        tries.append(number)
        if len(tries) < 3:
            raise HubError("it is out of reach; switch it on")
        yield
        return 1.0

    def wait(_is_over: object) -> None:
        messages.append(page.board.status[1]["message"])
        assert not page.is_stopped
        page.is_reset_requested = True

    monkeypatch.setattr(page, "wait_for_reset", wait)
    assert play_endlessly(Toy(), page, episode, episodes=1) == [1.0]
    assert tries == ["1"] * 3
    assert messages == ["it is out of reach; switch it on. Reset tries again."] * 2
    assert page.board.status[1]["message"] == ""


def test_training_is_shown_with_its_titles_episodes_and_curve(tmp_path: Path) -> None:
    page = LivePage("a run", task=get_task("RunAway-v0"))
    over = threading.Event()
    callback = PageCallback(page, over)
    config = TrainConfig("RunAway-v0", "random", episodes=5, seed=3)
    callback.on_start(config, Path("runs/one"), 0)
    status = page.board.status[1]
    assert (status["title"], status["subtitle"]) == ("RunAway-v0", "random, seed 3 · runs/one")
    done = TensorDict({"done": torch.ones(1, dtype=torch.bool)})
    done["observation"], done["reward"] = torch.zeros(5), torch.ones(1)
    going = done.clone()
    going["done"] = ~done["done"]
    page._press("reset", None)
    for step, after in ((1, going), (2, done)):
        if step == 2:
            page._press("reset", None)
        callback.on_transition(2, step, Phase.PREFILL, TensorDict({"next": after}))
        assert not page.is_reset_requested, "an episode begins and ends without one"
        page._due_s = 0.0
    facts = page.board.status[1]["facts"]
    assert (facts["episode"], facts["phase"], facts["step"]) == ("2/5", "random start", 2)
    over.set()
    page._press("pause", None)
    callback.on_step(2, 2, Phase.TRAIN)  # does not wait for a run that ends
    callback.on_link_lost(2, 2, HubError("it is off; switch it on"))
    says = "it is off; switch it on; trying to reach it again"
    assert page.board.status[1]["message"] == says
    episode = Episode(2, Phase.TRAIN, 2, 2, 7.0, None)
    callback.on_episode(episode, Progress.of([episode], 5))
    status = page.board.status[1]
    assert (status["message"], status["facts"]["episode"]) == ("", "2/5")
    assert list(page.board.series["return"].rows) == [(7.0,)] and page._steps == 0
    for interrupted, note in (
        (True, "interrupted; `bricksrl resume runs/one` goes on"),
        (False, ""),
    ):
        callback.on_end(RunResult(Path("runs/one"), (), interrupted))
        status = page.board.status[1]
        assert (status["state"], status["note"]) == ("finished", note)


def test_resting_robot_does_what_its_driver_says() -> None:
    with closing(bricksrl.make("Walker-v0", seed=0)) as env:
        state = TensorDict({"observation": torch.zeros(env.observation_spec["observation"].shape)})
        assert resting_player(env).act(state.clone())["action"].tolist() == [1.0] * 4
        driven = torch.tensor([0.5] * 4)
        drivers = iter([driven, None])
        player = resting_player(env, lambda _observation: next(drivers))
        assert player.act(state.clone())["action"] is driven
        assert player.act(state.clone())["action"].tolist() == [1.0] * 4
