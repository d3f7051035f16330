"""Numbers of the arenas: what scripts decide, what goes to hubs and back, when episodes end, and
what the air makes of what is told."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Unbounded

from brickhub.entry import Entry
from brickhub.hub.interface import RunAngle, Wait
from bricksrl.envs.arenas import ARENAS, arena_summary, get_arena_task, make_arena
from bricksrl.envs.arenas.arena_env import ArenaEnv, _distance_m
from bricksrl.envs.arenas.arena_task import ArenaState, ArenaTask, steer_towards
from bricksrl.envs.arenas.carry import CARRY
from bricksrl.envs.arenas.guide import GATE
from bricksrl.envs.arenas.simulated_air import SimulatedAir
from bricksrl.envs.arenas.tag import RUNNER, TAG, flee, observe
from bricksrl.envs.specs import NominalBounded
from bricksrl.errors import DescriptionError
from bricktwin.twin.physics import Physics

Point = tuple[float, float]

# ---------------------------------------------------------------- scripts

CATCHER_M, RUNNER_M = 0.073, 0.055
"""Ways in a step: wheels of 56 mm that turn by 150 and by 112 degrees."""


def steps_until_caught(runner: Point, heading: float, catcher: Point, direction: float) -> float:
    """How long a runner that turns into a direction, by 0.7 rad a step, and drives on is free, in
    16 steps at most; and the metres between the two in these steps."""
    apart = abs(math.remainder(direction - heading, math.tau))
    turning = apart / 0.7
    score = 0.0
    for step in range(1, 17):
        way_m = RUNNER_M * min(max(step - turning, 0.0), 1.0)
        x = min(max(runner[0] + way_m * math.cos(direction), -0.73), 0.73)
        y = min(max(runner[1] + way_m * math.sin(direction), -0.73), 0.73)
        runner = (x, y)
        gap_m = math.dist(runner, catcher)
        if gap_m <= 0.2 + CATCHER_M:
            break
        share = CATCHER_M / gap_m
        catcher = (
            catcher[0] + share * (runner[0] - catcher[0]),
            catcher[1] + share * (runner[1] - catcher[1]),
        )
        score += 1.0 + gap_m
    return score


def test_a_runner_takes_the_way_on_which_it_is_caught_last() -> None:
    generator = torch.Generator().manual_seed(4)
    places = torch.rand((60, 2, 2), generator=generator) * 1.4 - 0.7
    headings = torch.rand((60, 2, 1), generator=generator) * math.tau
    poses = torch.cat((places, headings), -1)
    observations = observe(ArenaState(poses, torch.zeros(60, 2, 2)))[:, RUNNER]
    actions = flee(observations)
    directions = [number * math.tau / 16 for number in range(16)]
    decided = 0
    for (catcher, runner), action in zip(poses.tolist(), actions, strict=True):
        heading = runner[2]
        place, other = (runner[0], runner[1]), (catcher[0], catcher[1])
        scores = [steps_until_caught(place, heading, other, one) for one in directions]
        first, second = sorted(scores)[:-3:-1]
        # Single precision may decide between two ways that are as good.
        if first - second < 1e-3:
            continue
        decided += 1
        turn = directions[scores.index(first)] - heading
        wanted = steer_towards(torch.tensor(math.cos(turn)), torch.tensor(math.sin(turn)))
        assert action.tolist() == pytest.approx(wanted.tolist(), abs=1e-3)
    assert decided > 30


# ---------------------------------------------------------------- hubs


def readings_of(task: ArenaTask, *angles: tuple[float, float]) -> list[Any]:
    """Readings of the robots' wheels."""
    found = []
    for interface, (left, right) in zip(task.interfaces, angles, strict=True):
        by_name = {"left": left, "right": right}
        motors = [by_name.get(getattr(one, "motor", ""), 0.0) for one in interface.channels]
        found.append(SimpleNamespace(values=motors))
    return found


def test_actions_go_to_the_hubs_in_degrees_and_turns_come_back_as_shares(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with closing(make_arena("Tag-v0", seed=3)) as env:
        state = env.reset()
        env._angles = torch.tensor([[350.0, 10.0], [0.0, 180.0]])
        sent: list[Any] = []

        def exchange(commands: list[list[float]]) -> list[Any]:
            sent.append(commands)
            return readings_of(TAG, (20.0, 340.0), (56.0, 96.0))

        monkeypatch.setattr(env, "_exchange", exchange)
        state["catcher", "action"] = torch.tensor([[0.5, -1.0]])
        state["runner", "action"] = torch.tensor([[7.0, 0.0]])
        after = env.step(state)["next"]
        assert sent == [[[75.0, -150.0], [112.0, 0.0]]]
        # Wheels turn the shorter way around.
        moved = after["catcher", "observation"][0, 8:].tolist()
        assert moved == pytest.approx([30 / 150, -30 / 150])
        moved = after["runner", "observation"][0, 8:].tolist()
        assert moved == pytest.approx([56 / 112, -84 / 112])
        poses = env.world.poses()
        for name, pose in zip(("catcher", "runner"), poses, strict=True):
            seen = after[name, "observation"][0, :4].tolist()
            heading = math.radians(-pose.heading_deg)
            wanted = [pose.x_m, pose.y_m, math.cos(heading), math.sin(heading)]
            assert seen == pytest.approx(wanted, abs=1e-5)
        one, other = poses
        apart_m = math.dist((one.x_m, one.y_m), (other.x_m, other.y_m))
        assert _distance_m(env.world, 0, 1) == pytest.approx(apart_m)


def test_numbers_that_robots_tell_go_to_their_hubs_as_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with closing(make_arena("Guide-v0", seed=3)) as env:
        state = env.reset()
        sent: list[Any] = []

        def exchange(commands: list[list[float]]) -> list[Any]:
            sent.append(commands)
            return readings_of(GATE, (0.0, 0.0), (0.0, 0.0))

        monkeypatch.setattr(env, "_exchange", exchange)
        state["agents", "action"] = torch.tensor([[1.0, -1.0, 0.25, -0.5], [0.5, 0.0, 1.0, 0.0]])
        env.step(state)
        assert sent == [[[5.0, -5.0, 0.25, -0.5], [75.0, 0.0, 1.0, 0.0]]]


def test_arena_that_is_made_again_is_made_in_the_same_way() -> None:
    physics = Physics(battery_v=7.0)
    plain = make_arena("Tag-v0", physics=physics, realtime=True)
    again: Any = plain.remake(seed=5)  # type: ignore[attr-defined, misc]
    assert isinstance(again, ArenaEnv)
    assert (again._physics, again._realtime, again._seed) == (physics, True, 5)
    deaf: Any = make_arena("Guide-v0", batch_size=3, deaf=True).remake(seed=5)  # type: ignore[attr-defined, misc]
    assert deaf._air is None and deaf.batch_size == (3,)


# ---------------------------------------------------------------- ends and specs


def test_episodes_of_copies_end_after_their_steps_each() -> None:
    task = replace(TAG, max_steps=3)
    env = make_arena(task, seed=1, batch_size=2)
    state = env.reset()

    def stepped(state: Any) -> Any:
        for group in ("catcher", "runner"):
            state[group, "action"] = torch.zeros(2, 1, 2)
        return env.step(state)["next"]

    ends = []
    for _ in range(2):
        state = stepped(state)
        ends.append(state["truncated"][:, 0].tolist())
    # The second copy begins anew.
    env.reset(TensorDict({"_reset": torch.tensor([[False], [True]])}, [2]))
    for _ in range(3):
        state = stepped(state)
        ends.append(state["truncated"][:, 0].tolist())
        assert torch.equal(state["done"], state["terminated"] | state["truncated"])
        assert not bool(state["link_lost"].any())
    assert ends == [[False] * 2, [False] * 2, [True, False], [True, False], [True, True]]


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("success", True, "success of Tag-v0 is True; compute a tensor of shape [2, 1] and bool"),
        (
            "success",
            torch.zeros(2, 1),
            (
                "success of Tag-v0 is of shape [2, 1] and float32; compute a tensor of shape "
                "[2, 1] and bool"
            ),
        ),
        (
            "observe",
            torch.zeros(2, 2, 9),
            (
                "observe of Tag-v0 is of shape [2, 2, 9] and float32; compute a tensor of shape "
                "[2, 2, 10] and float32"
            ),
        ),
        (
            "observe",
            torch.zeros(2, 2, 10, dtype=torch.float64),
            (
                "observe of Tag-v0 is of shape [2, 2, 10] and float64; compute a tensor of shape "
                "[2, 2, 10] and float32"
            ),
        ),
    ],
)
def test_result_of_a_function_is_named_with_what_it_should_be(
    name: str, value: Any, says: str
) -> None:
    env = make_arena(replace(TAG, **{name: lambda state: value}), seed=0, batch_size=2)
    with pytest.raises(DescriptionError) as caught:
        env.reset()
    assert str(caught.value).replace("torch.", "") == says


def test_observations_of_a_group_are_bounded_where_all_entries_are() -> None:
    env = make_arena("Tag-v0", batch_size=2)
    spec = env.observation_spec["catcher", "observation"]
    assert isinstance(spec, NominalBounded) and spec.shape == (2, 1, 10)
    assert spec.high[0, 0].tolist() == pytest.approx(
        [0.8, 0.8, 1.0, 1.0, 2.3, 2.3, 1.0, 1.0, 2.0, 2.0]
    )
    entries = (*TAG.entries[:-1], Entry("right_moved", -2.0))
    env = make_arena(replace(TAG, entries=entries), batch_size=2)
    free = env.observation_spec["catcher", "observation"]
    assert isinstance(free, Unbounded) and free.shape == (2, 1, 10)
    action = env.action_spec["runner", "action"]
    assert action.shape == (2, 1, 2) and action.low.min() == -1.0 and action.high.max() == 1.0


def test_simulated_starts_and_draws_fill_their_ranges() -> None:
    env = make_arena("Guide-v0", seed=1, batch_size=500)
    env.reset()
    poses, drawn = env._state.poses, env._state.drawn
    guide, driver = poses[:, 0], poses[:, 1]
    for values, low, high in (
        (guide[:, 0], -0.66, -0.64),
        (guide[:, 1], -0.66, -0.64),
        (driver[:, 0], -0.5, -0.4),
        (driver[:, 1], -0.1, 0.1),
        (torch.rad2deg(driver[:, 2]), -30.0, 30.0),
        (drawn[:, 0], -0.5, 0.5),
    ):
        span = high - low
        assert low <= values.min() < low + 0.02 * span
        assert high - 0.02 * span < values.max() <= high + 1e-5
    tag = make_arena("Tag-v0", seed=1, batch_size=500)
    tag.reset()
    gaps = (tag._state.poses[:, 0, :2] - tag._state.poses[:, 1, :2]).norm(dim=-1)
    assert 0.6 <= gaps.min() < 0.62


def test_loads_are_simulated_by_no_copies() -> None:
    from bricksrl.envs.arenas.arena_env import ArenaSimulation

    with pytest.raises(DescriptionError) as caught:
        ArenaSimulation(CARRY, 2)
    says = "Carry-v0: only robots with a drive base, and no loads, are simulated so"
    assert str(caught.value) == says


# ---------------------------------------------------------------- pages of the arenas


def rows_of(task: ArenaTask, heading: str) -> list[list[str]]:
    """Rows of a table of an arena's page."""
    section = task.doc.split(f"## {heading}")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


@pytest.mark.parametrize("task", [TAG, CARRY, GATE], ids=lambda task: task.id)
def test_page_of_an_arena_has_the_ranges_of_its_entries(task: ArenaTask) -> None:
    numbers = []
    for places, names, low, high, _ in rows_of(task, "Observation"):
        first, _, last = places.partition("-")
        for place in range(int(first), int(last or first) + 1):
            numbers.append(place)
            entry = task.entries[place]
            assert (entry.low, entry.high) == (float(low), float(high)), entry.name
            start = names.split(",")[0]
            if place == int(first):
                assert entry.name == start
    assert numbers == list(range(len(task.entries)))
    ends = dict(rows_of(task, "End of an episode"))
    assert ends["truncated"].startswith(f"after {task.max_steps} steps")


@pytest.mark.parametrize("name", ARENAS)
def test_summary_of_an_arena_is_the_first_paragraph_of_its_page(name: str) -> None:
    first, _, _ = get_arena_task(name).doc.partition("\n\n")
    assert arena_summary(name) == " ".join(first.split())


def test_positions_without_walls_may_be_anywhere_that_a_robot_gets_to() -> None:
    limits = {entry.name: entry.limits for entry in CARRY.entries if entry.limits is not None}
    assert limits == {
        "x": (-5.0, 5.0),
        "y": (-5.0, 5.0),
        "beam_ahead": (-10.0, 10.0),
        "beam_left": (-10.0, 10.0),
        "mate_ahead": (-10.0, 10.0),
        "mate_left": (-10.0, 10.0),
    }
    assert all(entry.limits is None for entry in (*TAG.entries, *GATE.entries))


def test_who_carries_sees_the_beam_and_its_mate() -> None:
    poses = torch.tensor([(0.0, 0.2, 0.0), (0.1, -0.2, math.pi / 2), (0.3, 0.0, 0.1)])
    moved = torch.tensor([[0.5, 0.25], [-0.5, 1.0]])
    left, right = CARRY.observe(ArenaState(poses, moved))
    assert left.tolist() == pytest.approx(
        [0.0, 0.2, 1.0, 0.0, 0.3, -0.2, math.cos(0.1), math.sin(0.1), 0.1, -0.4, 0.5, 0.25],
        abs=1e-6,
    )
    turn = 0.1 - math.pi / 2
    assert right.tolist() == pytest.approx(
        [0.1, -0.2, 0.0, 1.0, 0.2, -0.2, math.cos(turn), math.sin(turn), 0.4, 0.1, -0.5, 1.0],
        abs=1e-6,
    )


def test_random_robots_act_and_tell_in_their_whole_range() -> None:
    torch.manual_seed(0)
    for task in (TAG, GATE):
        actions = task.script("random")(torch.zeros(4000, 10))
        assert actions.shape == (4000, task.action_size)
        assert -1.0 <= actions.min() < -0.99 and 0.99 < actions.max() <= 1.0
        assert actions.mean().abs() < 0.05
    with pytest.raises(DescriptionError) as caught:
        TAG.script("fly")
    says = "task Tag-v0: there is no script 'fly'; choose random, flee, chase"
    assert str(caught.value) == says


def test_gate_and_beam_are_as_large_as_their_pages_say() -> None:
    assert GATE.mark is not None
    places = GATE.mark(torch.tensor([0.25]))
    assert places.tolist() == [
        pytest.approx([0.4, y_m]) for y_m in (0.0, 0.25, 0.25 - 0.12, 0.25 + 0.12)
    ]
    halves = {mark.name: mark.half_size_m[1] for mark in GATE.arena.marks}
    assert halves == {"line": 0.8, "gate": 0.12, "right_post": 0.014, "left_post": 0.014}
    (beam,) = CARRY.arena.loads
    assert beam.half_size_m[1] == 0.35, "0.7 m, across"
    assert beam.place.x_m == (0.12, 0.12) and beam.place.y_m == (0.0, 0.0)
    assert [robot.place.y_m for robot in CARRY.arena.robots] == [
        pytest.approx((0.17, 0.23)),
        pytest.approx((-0.23, -0.17)),
    ]


def test_groups_and_steps_of_the_arenas() -> None:
    found = {
        task.id: (task.robots, dict(task.groups), task.max_steps, dict(task.opponents))
        for task in (TAG, CARRY, GATE)
    }
    assert found == {
        "Tag-v0": (
            ("catcher", "runner"),
            {"catcher": ("catcher",), "runner": ("runner",)},
            80,
            {"catcher": "chase", "runner": "flee,random"},
        ),
        "Carry-v0": (("left", "right"), {"agents": ("left", "right")}, 60, {}),
        "Guide-v0": (("guide", "driver"), {"agents": ("guide", "driver")}, 40, {}),
    }
    speeds = {TAG.id: 900, CARRY.id: 700, GATE.id: 900}
    for task in (TAG, CARRY, GATE):
        for interface in task.interfaces:
            assert interface.settle == Wait(250)
            for command in interface.commands[:2]:
                assert isinstance(command, RunAngle)
                assert command.speed_deg_s == speeds[task.id]


# ---------------------------------------------------------------- the air


def test_what_is_told_goes_in_hundredths_of_its_range() -> None:
    air = SimulatedAir(copies=2, robots=2, told=1, step_ms=500, seed=0)
    heard = air.step(torch.tensor([[[1.7], [-0.256]], [[-3.0], [0.254]]]))
    wanted = torch.tensor([[[-0.26], [1.0]], [[0.25], [-1.0]]])
    assert torch.allclose(heard, wanted)


def test_episode_begins_with_zeros_in_the_copies_that_are_reset_alone() -> None:
    air = SimulatedAir(copies=3, robots=2, told=2, step_ms=500, seed=0)
    air.step(torch.full((3, 2, 2), 0.5))
    before_ms = [copy.time_ms for copy in air._copies]
    heard = air.restart(torch.tensor([True, False, True]))
    assert heard.shape == (2, 2, 2) and not bool(heard.any())
    after_ms = [copy.time_ms for copy in air._copies]
    assert after_ms[1] == before_ms[1]
    # A step, the way of a command, and the time in which the robots are placed.
    assert after_ms[0] - before_ms[0] == after_ms[2] - before_ms[2] > 500 + 110
