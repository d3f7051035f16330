"""Robots on the page at once: without TorchRL, as the environment itself, not reset while one
drives; signals end them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import closing, contextmanager
from urllib.request import urlopen

import numpy as np
import pytest
import torch
from browser import chromium, tab
from forked import ForkServer, Scratch

import bricksrl
from bricksrl.envs import get_task
from bricksrl.envs.make import make
from bricksrl.envs.tasks.scripted import CONTROLLERS
from bricksrl.errors import StoppedError
from bricksrl.page.live import LivePage
from bricksrl.page.play import play_on_page, resting_player
from bricksrl.page.robot_play import Judge, play_robot

MOVED = """
import sys
from bricksrl.envs import get_task
from bricksrl.envs.make import make
from bricksrl.page import live, robot_play
from bricksrl.policies.by_name import array_policies
env = make("Walker-v1", seed=0, arrays=True)
policy = list(array_policies("Walker-v1", env.task, 0).values())[-1]()
before = env.begin().observation
after = env.move(policy({"observation": before.copy()}).tolist())
env.close()
assert abs(after[:4] - before[:4]).max() > 5.0, (before, after)
assert not {"torch", "torchrl", "tensordict"} & set(sys.modules)
"""


def test_robot_moves_without_torch():
    subprocess.run([sys.executable, "-c", MOVED], check=True, timeout=60)


@pytest.mark.parametrize("env_id", ["Walker-v1", "Spinning-v0", "Park-v0", "RoboArm-v0"])
def test_robot_is_the_environment(env_id):
    with (
        closing(bricksrl.make(env_id, seed=3)) as env,
        closing(make(env_id, seed=3, arrays=True)) as robot,
    ):
        state, observation = env.reset(), robot.begin().observation
        for _ in range(3):
            np.testing.assert_array_equal(state["observation"].numpy(), observation)
            action = np.asarray(
                CONTROLLERS[env_id]({"observation": observation.copy()}), np.float32
            ).clip(-1, 1)
            state = env.step(state.set("action", torch.from_numpy(action)))["next"]
            observation = robot.move(action.tolist())


def played(env_id: str, **named: object) -> tuple[object, LivePage]:
    env = make(env_id, seed=0, arrays=True)
    return env, LivePage(env_id, task=env.task, **named)


def test_whole_episode_has_its_return():
    env, page = played("RunAway-v0", policies=("scripted",))
    with closing(env):
        (total,) = play_robot(
            env, page, {"scripted": lambda: CONTROLLERS["RunAway-v0"]}, episodes=1
        )
    assert total > 15.0
    assert page.board.status[1]["facts"]["return"] == pytest.approx(total)


def test_controller_sees_what_an_agent_sees():
    """Two further entries are for the task's functions alone."""
    env, page = played("RoboArm_mixed-v0", policies=("one",))
    stop = threading.Event()

    def act(state):
        assert state["observation"].shape == (3,) and state["image"].ndim == 3
        stop.set()
        return CONTROLLERS["RoboArm_mixed-v0"](state)

    with closing(env), pytest.raises(StoppedError):
        play_robot(env, page, {"one": lambda: act}, stop=stop)


def test_nothing_resets_while_one_drives():
    env, page = played("RunAway-v0", in_charge=True)
    steps, stop = 2 * env.task.max_steps, threading.Event()
    show, begun = page.show_outcome, []
    begin = env.begin
    env.begin = lambda: begun.append(1) or begin()

    def count(*arguments: object, **named: object) -> None:
        show(*arguments, **named)
        if page._steps == steps:
            stop.set()

    page.show_outcome = count
    page.attach = lambda env: None  # at full speed
    with closing(env), pytest.raises(StoppedError):
        play_robot(env, page, {}, stop=stop)
    assert len(begun) == 1 and page._steps >= steps


@pytest.mark.parametrize("is_plain", [True, False])
def test_paused_page_ends_when_it_is_stopped(is_plain):
    env = make("RunAway-v0", seed=0, arrays=is_plain)
    page, stop = LivePage("RunAway-v0", task=env.task, policies=("",)), threading.Event()
    page._press("pause", None)
    timer = threading.Timer(0.5, stop.set)
    timer.start()
    play = play_robot if is_plain else play_on_page
    player = (lambda _state: np.zeros(1)) if is_plain else resting_player(env)
    with closing(env), pytest.raises(StoppedError):
        play(env, page, {"": lambda: player}, stop=stop)
    timer.join()


@contextmanager
def command(
    processes: ForkServer | Scratch, *words: str
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A command with a page, and its address."""
    streams = (None, None, subprocess.PIPE)
    with processes.start(words, streams, environment=dict(os.environ)) as process:
        assert process.stderr is not None
        found = None
        try:
            while found is None:
                line = process.stderr.readline()
                assert line, "it ended"
                found = re.search(r"http://\S+", line)
            yield process, found[0]
        finally:
            process.kill()


def pressing(url: str, name: str) -> None:
    """Press a button of a page, as a browser does, and wait until the page says so."""
    from websockets.sync.client import connect

    with urlopen(url) as response:
        cookie = response.headers["Set-Cookie"].partition(";")[0]
    host = url.split("/")[2]
    with connect(
        f"ws://{host}/ws", origin=f"http://{host}", additional_headers={"Cookie": cookie}
    ) as socket:
        socket.send(json.dumps({"press": name, "value": None}))
        for message in socket:
            if (
                isinstance(message, str)
                and json.loads(message).get("status", {}).get("state") == "paused"
            ):
                return


@pytest.mark.realtime
@pytest.mark.parametrize(
    "words", [("demo",), ("drive", "RunAway-v0"), ("play", "WalkerSim-v0", "--page")]
)
def test_paused_page_ends_at_sigterm(processes, words):
    with command(processes, *words) as (process, url):
        pressing(url, "pause")
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 130


@pytest.mark.realtime
def test_demo_walks_in_the_browser(processes):
    """From the command to a robot that has moved."""
    with (
        chromium() as browser,
        command(processes, "demo") as (_, url),
        tab(browser, url) as page,
    ):
        page.locator("[data-fact=distance]").filter(
            has_text=re.compile(r"0\.(0[3-9]|[1-9])")
        ).wait_for()
        page.locator("#policy").select_option("random")
        page.locator("[data-fact=return]").wait_for()


def test_judge_counts_what_was_seen_before_it_could_judge():
    task = get_task("RunAway-v0")
    judge = Judge(task)
    near, far, farthest = ([0.0, 0.0, 0.0, 0.0, mm] for mm in (200.0, 300.0, 1990.0))
    judge._torch = Future()  # still being loaded
    judge.see(near, [1.0], far)
    judge.see(far, [1.0], near)
    assert (judge.total, judge.rewards, judge.is_over) == (0.0, [], False)
    judge._torch.set_result(torch)
    judge.see(near, [1.0], far)
    assert (judge.total, judge.rewards, judge.is_over) == (1.0, [1.0, -1.0, 1.0], False)
    judge.see(far, [1.0], farthest)
    assert judge.end() == 2.0 and judge.is_over == bool(task.terminated(torch.tensor(farthest)))
    judge.begin()
    assert (judge.total, judge.rewards, judge.is_over, judge.end()) == (0.0, [], False, 0.0)
