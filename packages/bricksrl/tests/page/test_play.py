"""Playing on the page."""

from __future__ import annotations

import threading
from contextlib import closing
from pathlib import Path

import pytest
from tensordict import TensorDictBase

import bricksrl
from bricksrl.errors import PageError, StoppedError
from bricksrl.page.live import LivePage
from bricksrl.page.play import play_on_page, resting_player
from bricksrl.page.program import ProgramPage
from bricksrl.policies.policy import Player, random_player


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
