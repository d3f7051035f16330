"""A robot behind a link that notes what it is asked for: the order of a start, what ends it, trials
of its hub, obstacles, and the scenes that the pages of tasks describe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from brickhub.hub.interface import Heading, RunAngle, UntilDone, Wait
from brickhub.hub.link.robot_link import Reading
from bricksrl.envs import get_task
from bricksrl.envs import robot_env as robots
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import BLOCKED_TIMEOUT_S, HubEnv
from bricksrl.envs.hub_policy import HubPolicy
from bricksrl.envs.robot_env import RobotEnv
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import BricksError, DescriptionError, HubError, StoppedError
from bricktwin.twin.objects import Field, Line


class Link:
    """A link whose robot reads the same but for what the test changes."""

    def __init__(self, log: list[Any], count: int) -> None:
        self.log = log
        self.values = [0.0] * count
        self.clock_s = 100.0
        self.age_s = 0.0
        self.is_open = False
        self.error: Exception | None = None

    def now_s(self) -> float:
        return self.clock_s

    def _reading(self) -> Reading:
        if self.error is not None:
            raise self.error
        return Reading(
            values=tuple(self.values),
            age_s=self.age_s,
            hub_time_ms=1234,
            round_trip_s=0.5,
        )

    def open(self) -> None:
        self.log.append("open")
        self.is_open = True

    def read(self) -> Reading:
        self.log.append("read")
        return self._reading()

    def act(self, commands: Any) -> Reading:
        self.log.append(("act", list(commands)))
        return self._reading()

    def step(self, numbers: Any, steps: int) -> Reading:
        self.log.append(("step", list(numbers), steps))
        return self._reading()

    def rest(self) -> None:
        self.log.append("rest")

    def close(self) -> None:
        self.log.append("close")
        self.is_open = False

    def release(self) -> None:
        self.log.append("release")


class Device:
    """A camera, or a reader of a sensor."""

    def __init__(self, name: str, log: list[Any]) -> None:
        self.name = name
        self.log = log
        self.sensor = SimpleNamespace(image_px=0, observes_age=True, name=name)

    def open(self) -> None:
        self.log.append(f"open {self.name}")

    def latest(self) -> tuple[Any, float]:
        return [7.0], 0.25

    def close(self) -> None:
        self.log.append(f"close {self.name}")


def robot_of(
    task: Task = SPINNING,
    kind: type[RobotEnv] = RobotEnv,
    **parts: Any,
) -> tuple[Any, Link, list[Any]]:
    log: list[Any] = []
    link = Link(log, len(task.interface.channels))

    def connect(_seed: int) -> Connection:
        log.append("connect")
        place: Callable[..., None] = lambda _rng: log.append("place")  # noqa: E731
        return Connection(link, place, **parts)  # type: ignore[arg-type]

    return kind(task, connect, seed=0), link, log


# ---------------------------------------------------------------- starts


def test_robot_is_connected_placed_and_read_once() -> None:
    env, _, log = robot_of()
    episode = env.begin()
    assert log == ["connect", "open", "place", "read"]
    assert episode.observation.tolist()[:5] == [0.0] * 5
    env.begin()
    assert log[4:] == ["open", "place", "read"]
    env.close()
    assert log[-1] == "close" and env.episode is None


def test_sensors_are_opened_before_the_robot_is_placed_and_closed_with_it() -> None:
    log: list[Any] = []
    sensors = (Device("scale", log), Device("eye", log))
    env, link, of_link = robot_of(sensors=sensors, camera=Device("camera", log))
    link.log = log
    env.begin()
    assert log == ["open", "open scale", "open eye", "read"]
    assert of_link == ["connect", "place"]
    env.close()
    assert log[4:] == ["close", "close scale", "close eye", "close camera"]


def test_numbers_of_sensors_follow_the_channels_with_their_ages() -> None:
    sensor = Device("scale", [])
    env, _, _ = robot_of(sensors=(sensor,))
    observation = env.begin().observation
    assert observation.tolist()[5:7] == [7.0, 0.25]
    sensor.sensor.observes_age = False
    assert env.begin().observation.tolist()[5:6] == [7.0]
    assert len(env.begin().observation) == len(observation) - 1


def test_link_that_breaks_at_the_start_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    env, link, log = robot_of()
    link.error = HubError("gone")
    with pytest.raises(HubError, match="gone"):
        env.begin()
    assert log == ["connect", "open", "place", "read", "close"] and env.episode is None


def test_paused_robot_is_read_until_it_may_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    env, link, log = robot_of()
    waits = iter([False, False, True])
    asked: list[float] = []
    monkeypatch.setattr(env, "_waited", lambda timeout_s: asked.append(timeout_s) or next(waits))
    link.is_open = True
    env.begin()
    assert log == ["connect", "read", "read", "open", "place", "read"]
    assert asked == [robots.PAUSE_PERIOD_S] * 3
    log.clear()
    waits = iter([False, True])
    link.is_open = False
    env.begin()
    assert log == ["open", "place", "read"], "who is not connected is not read"


def test_wait_ends_at_once_without_a_pause_and_at_a_stop() -> None:
    env, _, _ = robot_of()
    assert env._waited(0.0)
    env.pause()
    assert not env._waited(0.0)
    env.stop()
    assert env._waited(0.0)
    with pytest.raises(StoppedError) as caught:
        env.begin()
    assert str(caught.value) == (
        "the robot was stopped by hand; call resume() when it may move again"
    )
    env.resume()
    assert not env.is_paused and env._waited(0.0)
    env.begin()


def test_connection_is_shown_to_who_watches_until_that_one_leaves() -> None:
    env, _, _ = robot_of()
    seen: list[Any] = []
    leave = env.watch(lambda connection: seen.append(("first", connection)))
    assert seen == []
    connection = env._connected()
    later = env.watch(lambda connection: seen.append(("second", connection)))
    assert seen == [("first", connection), ("second", connection)]
    leave()
    later()
    assert env._watchers == []


# ---------------------------------------------------------------- steps


def test_commands_are_in_their_units_and_their_age_is_that_of_what_was_seen() -> None:
    task = replace(
        SPINNING,
        interface=replace(
            SPINNING.interface,
            commands=(RunAngle("left", -100, 0, 400), RunAngle("right", 20, 60, 400)),
        ),
    )
    env, link, log = robot_of(task)
    with pytest.raises(BricksError, match="^Spinning-v0 has no episode to step; reset the env"):
        env.move([0.0, 0.0])
    link.age_s = 0.02
    env.begin()
    link.clock_s += 0.25
    link.values[4] = 33.0
    observation = env.move([0.5, -1.0])
    assert log[-1] == ("act", [-25.0, 20.0])
    assert observation.tolist()[4] == 33.0
    assert env.episode.age_s == pytest.approx(0.27)
    assert env.episode.hub_time_s == pytest.approx(1.234)
    assert env.episode.measured_s == pytest.approx(link.clock_s - 0.02)


def test_accumulating_channel_counts_from_the_start_of_the_episode() -> None:
    channels = (*SPINNING.interface.channels, Heading())
    task = replace(SPINNING, interface=replace(SPINNING.interface, channels=channels))
    env, link, _ = robot_of(task)
    link.values[0] = 90.0
    link.values[5] = 400.0
    assert env.begin().observation.tolist()[:6] == [90.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    link.values[5] = 370.0
    assert env.move([0.0, 0.0]).tolist()[:6] == [90.0, 0.0, 0.0, 0.0, 0.0, -30.0]


def policy(*trials: tuple[list[float], int | None]) -> HubPolicy:
    return HubPolicy((), "", 60.0, iter(trials).__next__)


def test_hub_makes_trials_that_end_with_the_episode_and_are_no_longer_than_it_can(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(robots, "most_steps", lambda _interface: 20)
    env, _, log = robot_of()
    made: list[Any] = []
    connect = env._connect
    env.connect_to = lambda policy: made.append(policy) or connect
    env.begin()
    trials = policy(([1.0], 5), ([2.0], 90), ([3.0], None), ([4.0], None))
    env.act_by_trials(trials)
    env.act_by_trials(trials)
    assert made == [trials] and log.count("close") == 1
    episode = env.begin()
    for done in (0, 5, 25, 45):
        episode.step_count = done
        env.move([0.0, 0.0])
    steps = [entry[1:] for entry in log if entry[0] == "step"]
    # An episode has 50 steps.
    assert steps == [([1.0], 5), ([2.0], 20), ([3.0], 20), ([4.0], 5)]
    env.act_by_trials(None)
    env.begin()
    env.move([1.0, 0.0])
    assert made == [trials, None] and log[-1] == ("act", [100.0, 0.0])


def test_hub_that_needs_the_computer_for_each_step_makes_no_trials() -> None:
    env, _, log = robot_of()
    env.begin()
    env.act_by_trials(policy())
    env.move([0.0, 0.0])
    assert log[-1] == ("act", [0.0, 0.0]) and "close" not in log


# ---------------------------------------------------------------- TorchRL


def act(env: HubEnv) -> Any:
    return env.step(TensorDict({"action": torch.zeros(env.action_spec.shape)}))["next"]


def test_pause_rests_the_robot_after_the_step_and_cuts_the_episode() -> None:
    env, _, log = robot_of(kind=HubEnv)
    env.reset()
    env.pause()
    after = act(env)
    assert log[-2:] == [("act", [0.0, 0.0]), "rest"]
    assert bool(after["truncated"]) and not bool(after["terminated"]) and env.is_cut


def test_blocked_robot_waits_for_two_minutes_and_moves_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    task = get_task("Walker-v0")
    env, link, log = robot_of(task, HubEnv)
    link.values[6] = 30.0
    env.reset()
    log.clear()
    after = act(env)
    # Each look takes half a second; the last one is the first beyond two minutes.
    looks = int(BLOCKED_TIMEOUT_S / 0.5) + 1
    assert log == [*["read"] * looks, "close"]
    assert bool(after["link_lost"]) and bool(after["truncated"])
    assert str(env.link_error) == (
        "Walker-v0: something is in the robot's way for 120 s; clear it and go on"
    )
    assert caplog.messages == [
        "Walker-v0: something is in the robot's way; it waits until that is gone"
    ]


def test_reward_that_is_no_number_is_told_with_its_step() -> None:
    task = replace(SPINNING, reward=lambda previous, action, observation: observation[:1] / 0.0)
    env, _, _ = robot_of(task, HubEnv)
    env.reset()
    with pytest.raises(DescriptionError) as caught:
        act(env)
    assert str(caught.value).startswith(
        "the reward of Spinning-v0 is [nan] in step 1, where the observation is [0.0, 0.0, 0.0, "
    )
    assert str(caught.value).endswith("]; correct the task's reward")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"terminated": lambda observation: observation[:1]},
            "terminated of Spinning-v0 is [0.0], not true or false; compare",
        ),
        (
            {"reward": lambda previous, action, observation: 3},
            "reward of Spinning-v0 is 3; compute a tensor of shape [1] from the observation",
        ),
        (
            {"reward": lambda previous, action, observation: observation},
            (
                "reward of Spinning-v0 is of shape [6]; compute a tensor of shape [1] from the "
                "observation"
            ),
        ),
    ],
)
def test_outcome_that_is_none_is_told(changes: dict[str, Any], says: str) -> None:
    env, _, _ = robot_of(replace(SPINNING, **changes), HubEnv)
    env.reset()
    with pytest.raises(DescriptionError) as caught:
        act(env)
    assert str(caught.value) == says


def test_timing_of_a_robot_is_that_of_its_last_step() -> None:
    env, link, _ = robot_of(kind=HubEnv)
    for begin in (lambda: None, env.reset):
        begin()
        with pytest.raises(BricksError, match="^Spinning-v0 has made no step yet; make one first"):
            _ = env.timing
    act(env)
    timed = env.timing
    link.error = HubError("gone")
    assert bool(act(env)["link_lost"])
    assert env.timing is timed, "the episode is over, but its last step is known"


def test_judged_steps_are_those_of_the_present_episode() -> None:
    env, _, _ = robot_of(get_task("Park-v0"), HubEnv)
    env.reset()
    act(env)
    with pytest.raises(BricksError) as caught:
        env.task_observations(torch.zeros(3, 7))
    says = "Park-v0 judges an episode before the next reset, and not 3 other steps"
    assert str(caught.value) == says
    assert env.task_observations(torch.zeros(1, 7)).shape == (1, 7)


# ---------------------------------------------------------------- pages of tasks

SPEEDS = {
    "RoboArm-v0": {"rotation": (100, 250), "low": (30, 250), "high": (60, 250), "grab": (25, 250)},
    "Spinning-v0": {"left": (100, 400), "right": (100, 400)},
}
SETTLES = {
    "LineFollow-v0": Wait(60),
    "Park-v0": Wait(200),
    "RoboArm-v0": Wait(250),
    "RoboArm_mixed-v0": Wait(250),
    "RunAway-v0": UntilDone(),
    "Spinning-v0": Wait(100),
    "Walker-v0": Wait(250),
    "Walker-v1": Wait(250),
    "Walker-v2": Wait(100),
}


def test_commands_turn_as_fast_and_answers_come_as_soon_as_the_pages_say() -> None:
    for env_id, settle in SETTLES.items():
        assert get_task(env_id).interface.settle == settle, env_id
    for env_id, speeds in SPEEDS.items():
        found = {}
        for command in get_task(env_id).interface.commands:
            assert isinstance(command, RunAngle)
            found[command.motor] = (command.high, command.speed_deg_s)
        assert found == speeds
    for env_id in ("Walker-v0", "Walker-v1", "Walker-v2"):
        for command in get_task(env_id).interface.commands:
            assert isinstance(command, RunAngle) and command.speed_deg_s == 600


def test_scenes_are_those_of_the_pages() -> None:
    run_away = get_task("RunAway-v0").scene
    assert run_away.wall_distance_mm == (200.0, 300.0) and run_away.heading_deg == (-5.0, 5.0)
    park = get_task("Park-v0").scene
    assert park.start_mm == ((-550.0, -300.0), (-150.0, 150.0))
    assert park.heading_deg == (-40.0, 40.0)
    bay, line = park.objects
    assert isinstance(bay, Field) and isinstance(line, Line)
    assert bay.size_mm == (220.0, 200.0)
    # Three sides of the bay: the robot drives in at its back.
    corners = [(-110.0, 100.0), (110.0, 100.0), (110.0, -100.0), (-110.0, -100.0)]
    assert list(line.points_mm) == corners and not line.closed
    course = get_task("LineFollow-v0").scene
    # The sensor is 56 mm in front of the axle, and starts near the edge.
    assert course.start_mm == ((-60.0, -50.0), (-2.0, 2.0))
    assert course.heading_deg == (-4.0, 4.0)
    (track,) = course.objects
    assert isinstance(track, Line) and (track.width_mm, track.closed) == (30.0, True)
    assert len(track.points_mm) == 120
    assert get_task("RoboArm_mixed-v0").scene.ball and not get_task("RoboArm-v0").scene.ball


LEGS = ["left_front_angle", "right_front_angle", "left_back_angle", "right_back_angle"]
WHEELS = ["left_angle", "right_angle"]
# By task: what it says of itself, and which of its entries run around from 360 to 0 degrees.
KINDS: dict[str, tuple[set[str], list[str]]] = {
    "LineFollow-v0": ({"walks", "streams"}, []),
    "Park-v0": ({"observes_commands"}, []),
    "RoboArm-v0": (set(), ["rotation_angle", "rotation_goal"]),
    "RoboArm_mixed-v0": (set(), ["rotation_angle"]),
    "RunAway-v0": (set(), WHEELS),
    "Spinning-v0": (set(), WHEELS),
    "Walker-v0": ({"walks"}, LEGS),
    "Walker-v1": ({"walks", "symmetric"}, LEGS),
    "Walker-v2": ({"walks", "symmetric", "streams", "observes_commands"}, LEGS),
    "WalkerSim-v0": ({"walks", "symmetric"}, LEGS),
}


@pytest.mark.parametrize("env_id", KINDS)
def test_tasks_measure_mirror_and_stream_what_their_pages_say(env_id: str) -> None:
    task = get_task(env_id)
    kinds, wraps = KINDS[env_id]
    flags = ("walks", "symmetric", "streams", "observes_commands")
    assert {flag for flag in flags if getattr(task, flag)} == kinds
    assert [entry.name for entry in task.entries if entry.wraps] == wraps


def test_walkers_of_other_step_times_walk_for_25_seconds() -> None:
    assert [get_task("Walker-v1", step_ms=ms).max_steps for ms in (250, 100, 1000)] == [
        100,
        250,
        25,
    ]
    fast = get_task("Walker-v1", step_ms=100)
    steps = np.full((10, 8), 4.0)
    assert bool(fast.success(torch.tensor(steps)))
    assert not bool(fast.success(torch.tensor(steps * 0.99)))
    assert get_task("Walker-v2").streams and not get_task("Walker-v1").streams
