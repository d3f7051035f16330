"""Tasks: pure, batched functions with the numbers of the tables."""

from __future__ import annotations

import dataclasses
import math
from contextlib import closing

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import bricksrl
from brickhub.hub.interface import Distance, DriveStraight, Interface, MotorAngle, UntilDone
from bricksrl.envs.host_sensors.host_sensor import HostSensor
from bricksrl.envs.registry import get_task
from bricksrl.envs.rollout import play_episodes
from bricksrl.envs.task import SampledEntry, Task, check_measures
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import DescriptionError

DISTANCES_MM = st.integers(0, 2000).map(float)
RATES_DEG_S = st.integers(-3000, 3000).map(lambda tenths: tenths / 10)


def at_distance(*distances_mm: float) -> torch.Tensor:
    """RunAway observations ``[len(distances), 5]``."""
    observations = torch.zeros(len(distances_mm), 5)
    observations[:, 4] = torch.tensor(distances_mm)
    return observations


def turning(direction: float, *rates_deg_s: float) -> torch.Tensor:
    """Spinning observations ``[len(rates), 6]``."""
    observations = torch.zeros(len(rates_deg_s), 6)
    observations[:, 4] = torch.tensor(rates_deg_s)
    observations[:, 5] = direction
    return observations


@given(before=DISTANCES_MM, after=DISTANCES_MM)
def test_run_away_rewards_the_sign_of_the_change(before: float, after: float) -> None:
    reward = RUN_AWAY.reward(at_distance(before), torch.zeros(1, 1), at_distance(after))
    expected = 0.0 if after <= 40 or after == before else 1.0 if after > before else -1.0
    assert reward.tolist() == [[expected]]


@pytest.mark.parametrize(
    ("distance_mm", "ends"),
    [(39, True), (40, True), (41, False), (250, False), (1999, False), (2000, True)],
)
def test_run_away_ends_at_the_wall_and_out_of_sight(distance_mm: float, ends: bool) -> None:
    assert RUN_AWAY.terminated(at_distance(distance_mm)).tolist() == [[ends]]


@pytest.mark.parametrize(
    ("path_mm", "succeeds"),
    [((300, 999), False), ((900, 1000), True), ((1900, 2000), True), ((100, 40), False)],
)
def test_run_away_succeeds_when_it_ends_a_metre_away(
    path_mm: tuple[float, ...], succeeds: bool
) -> None:
    episode = at_distance(*path_mm)
    assert RUN_AWAY.success(episode).item() is succeeds
    assert RUN_AWAY.metrics(episode)["final_distance_mm"].item() == path_mm[-1]


def test_run_away_reports_max_tilt() -> None:
    episode = at_distance(300, 400, 500)
    episode[:, 2] = torch.tensor([1.0, -4.0, 2.0])
    assert RUN_AWAY.metrics(episode)["largest_pitch_deg"].item() == 4.0


def test_walker_episode_takes_25_seconds() -> None:
    task = get_task("Walker-v0", step_ms=500)
    assert (task.max_steps, task.interface.settle.fixed_ms) == (50, 500)
    assert get_task("Walker-v0").max_steps == 100
    for step_ms in (0, 25_001, 100.5):
        with pytest.raises(DescriptionError, match="step_ms"):
            get_task("Walker-v0", step_ms=step_ms)


@given(rate=RATES_DEG_S)
def test_spinning_rewards_left_turns_or_right_turns_without_clipping(rate: float) -> None:
    left, right = turning(0, rate), turning(1, rate)
    assert SPINNING.reward(left, torch.zeros(1, 2), left).item() == pytest.approx(rate)
    assert SPINNING.reward(right, torch.zeros(1, 2), right).item() == pytest.approx(-rate)
    assert SPINNING.terminated(left).tolist() == [[False]]


@pytest.mark.parametrize(
    ("direction", "rates", "succeeds", "mean"),
    [
        (0, (90, 110), True, 100),
        (0, (90, 109), False, 99.5),
        (0, (-200, -200), False, -200),
        (1, (-150, -160), True, 155),
        (1, (150, 160), False, -155),
    ],
)
def test_spinning_succeeds_when_fast_the_right_way_round(
    direction: float, rates: tuple[float, ...], succeeds: bool, mean: float
) -> None:
    episode = turning(direction, *rates)
    assert SPINNING.success(episode).item() is succeeds
    assert SPINNING.metrics(episode)["mean_yaw_rate_deg_s"].item() == pytest.approx(mean)


@pytest.mark.parametrize("task", [RUN_AWAY, SPINNING], ids=lambda task: task.id)
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)], ids=str)
def test_all_functions_are_batched(task: Task, batch: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(0)
    n, m, steps = len(task.entries), len(task.interface.commands), 4
    episode = torch.rand((*batch, steps, n), generator=generator) * 300
    before, after = episode[..., 0, :], episode[..., 1, :]
    action = torch.zeros((*batch, m))
    reward, ends = task.reward(before, action, after), task.terminated(after)
    assert reward.shape == ends.shape == (*batch, 1)
    assert reward.dtype == torch.float32
    assert ends.dtype == torch.bool
    assert task.success(episode).shape == batch
    assert task.success(episode).dtype == torch.bool
    assert all(value.shape == batch for value in task.metrics(episode).values())


def test_nominal_entries_are_measured_and_exceedable() -> None:
    assert [entry.name for entry in RUN_AWAY.entries if entry.limits is not None] == []
    assert [(e.name, e.limits) for e in SPINNING.entries if e.limits is not None] == [
        ("yaw_rate", (-3276.7, 3276.7))
    ]
    arm = dataclasses.replace(
        RUN_AWAY,
        interface=dataclasses.replace(RUN_AWAY.interface, channels=(MotorAngle("left", -45, 10),)),
    )
    assert arm.entries[0].bounds == (-214748364.7, 214748364.7)


def test_sampled_entries_are_drawn_from_their_whole_range() -> None:
    rng = np.random.default_rng(0)
    assert {SampledEntry("direction", 0, 1, whole=True).draw(rng) for _ in range(50)} == {0.0, 1.0}
    goals = [SampledEntry("goal", -45, 10, "deg").draw(rng) for _ in range(200)]
    assert -45 <= min(goals) < -40 and 5 < max(goals) <= 10


def eye(name: str) -> HostSensor:
    """A camera that nobody opens."""
    return HostSensor(name, (), lambda: None, image_px=8)  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"id": "RunAway"}, "version"),
        ({"max_steps": 0}, "max_steps"),
        (
            {"interface": Interface((), RUN_AWAY.interface.channels, RUN_AWAY.interface.settle)},
            "command",
        ),
        ({"sampled_entries": (SampledEntry("distance", 0, 1),)}, "twice"),
        (
            {"sampled_entries": (SampledEntry("wind", 5, 1),)},
            "the range of wind ends below its start",
        ),
        ({"max_steps": None}, "max_steps is None; give a whole number"),
        ({"camera": True}, "camera is True; give CameraView"),
        ({"reward": 1.0}, "reward is 1.0; give a function"),
        (
            {"reward": lambda o: o},
            r"takes other arguments, \(o\); write a function of \(previous, action, observation\)",
        ),
        (
            {"metrics": lambda o, a: {}},
            r"metrics of .* takes other arguments, \(o, a\); write a function of \(observations\)",
        ),
        ({"terminated": lambda: True}, r"terminated of .* write a function of \(observation\)"),
        ({"interface": RUN_AWAY.interface.commands}, "interface is .*; give Interface"),
        (
            {"sampled_entries": (SampledEntry("wind", math.nan, 1),)},
            "the range of wind ends below its start",
        ),
        ({"sensors": (eye("reward"),)}, "'reward' is what each step has anyway"),
        ({"sensors": (eye("is_init"),)}, "'is_init' is what each step has anyway"),
        ({"sensors": (eye("distance"),)}, "pitch, roll, distance, distance names an entry twice"),
        ({"sensors": (eye("left"), eye("left"))}, "left, left names an entry twice"),
    ],
)
def test_invalid_task_raises(change: dict[str, object], words: str) -> None:
    with pytest.raises(DescriptionError, match=words):
        dataclasses.replace(RUN_AWAY, **change)  # type: ignore[arg-type]


def test_a_task_may_have_an_episode_of_one_step_and_an_entry_of_one_value() -> None:
    wind = SampledEntry("wind", 5, 5)
    task = dataclasses.replace(
        RUN_AWAY, max_steps=1, sampled_entries=(wind,), sensors=(eye("left"), eye("right"))
    )
    assert task.entries[-1] == wind
    assert wind.draw(np.random.default_rng(0)) == 5.0


@pytest.mark.parametrize("name", ["", " ", "_", "__ ", "a\nb", 3, None])
def test_a_measure_has_a_name_in_words(name: object) -> None:
    with pytest.raises(DescriptionError, match="metrics are named .*; take a name in words"):
        check_measures(["way_mm", name], "metrics")


@pytest.mark.parametrize(
    ("name", "other"),
    [("return", "task_return"), ("is_success", "task_is_success"), ("_way_", "task_way")],
)
def test_a_measure_has_a_name_of_its_own(name: str, other: str) -> None:
    told = f"metrics have the name '{name}', which each .*; give it another one, such as {other}$"
    with pytest.raises(DescriptionError, match=told):
        check_measures([name], "metrics")
    check_measures([other, "way_mm", "mean error"], "metrics")


def test_lists_make_an_interface_and_what_is_no_part_of_one_is_named() -> None:
    drive, eyes, done = DriveStraight(-100, 100), Distance("eyes"), UntilDone()
    assert Interface([drive], [eyes], done) == Interface((drive,), (eyes,), done)  # type: ignore[arg-type]
    for parts, words in (
        # a comma is missing
        (
            (drive, (eyes,), done),
            r"commands is DriveStraight\(.*\); give several values, each Command",
        ),
        (((drive,), (eyes,), UntilDone), "settle is of type type; give Wait"),
        (
            ((DriveStraight("far", 100),), (eyes,), done),
            "low of 'straight' is 'far'; give a number",
        ),  # type: ignore[arg-type]
    ):
        with pytest.raises(DescriptionError, match=words):
            Interface(*parts)


@pytest.mark.parametrize(
    ("function", "returned", "words"),
    [
        (
            "reward",
            1.0,
            "reward of Wrong-v0 is 1.0; compute a tensor of shape [1] from the observation",
        ),
        ("reward", torch.ones(5), "reward of Wrong-v0 is of shape [5]; compute a tensor"),
        ("terminated", False, "terminated of Wrong-v0 is False; compute a tensor"),
        (
            "terminated",
            torch.ones(1),
            "terminated of Wrong-v0 is [1.0], not true or false; compare",
        ),
        (
            "success",
            torch.ones(5),
            "success of Wrong-v0 is of shape [5]; give one number for an episode",
        ),
        (
            "metrics",
            {"way_mm": torch.ones(5)},
            "metrics['way_mm'] of Wrong-v0 is of shape [5]; give one number for an episode",
        ),
        (
            "metrics",
            None,
            "what metrics of Wrong-v0 returns is None; give a table of names and values",
        ),
    ],
)
def test_function_that_returns_something_else_is_named(
    function: str, returned: object, words: str
) -> None:
    bricksrl.register(
        dataclasses.replace(RUN_AWAY, id="Wrong-v0", max_steps=2, **{function: lambda *_: returned})
    )  # type: ignore[arg-type]
    with (
        closing(bricksrl.make("Wrong-v0", seed=0)) as env,
        pytest.raises(DescriptionError) as error,
    ):
        list(play_episodes(env, env.rand_action, 1, seed=0))
    assert str(error.value).startswith(words)
