"""Arenas: common clock, both interfaces, lost links."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from brickhub.hub.interface import Command, DriveStraight, DriveTurnRate, Pitch, RunAngle
from brickhub.hub.link.profiles import PROFILES
from brickhub.robot import Mount, PoweredUpSensor, SensorKind
from brickhub.virtual.stimuli import Sense
from bricksrl.envs.arenas import arena_env, get_arena_task, make_arena
from bricksrl.envs.arenas.arena_task import ArenaState, seen_from, steer_towards
from bricksrl.envs.arenas.tag import TAG
from bricksrl.errors import (
    BricksError,
    DescriptionError,
    HubError,
    RunError,
    TwinError,
    UnknownNameError,
)
from bricktwin.robots import ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.twin.arena import Arena, Contestant, Place
from bricktwin.twin.models.load import load_model
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.physics import Physics


def acted(env: Any, state: TensorDict, **actions: list[list[float]]) -> TensorDict:
    for group, values in actions.items():
        state[group, "action"] = torch.tensor(values)
    return env.step(state)["next"]


@pytest.mark.parametrize("name", ["Tag-v0", "Carry-v0", "Guide-v0"])
def test_torchrl_checks_its_specs(name: str) -> None:
    from torchrl.envs import check_env_specs

    env = make_arena(name, seed=3)
    check_env_specs(env)
    env.close()


def test_torchrl_checks_the_simulations_specs() -> None:
    from torchrl.envs import check_env_specs

    for name in ("Tag-v0", "Guide-v0"):
        check_env_specs(make_arena(name, seed=3, batch_size=4))
    assert make_arena("Tag-v0", batch_size=[3]).batch_size == torch.Size([3])


def test_robots_share_simulated_time() -> None:
    env = make_arena("Tag-v0", seed=1, physics=Physics().with_link(PROFILES["mac"]))
    state = env.reset()
    clocks = [env.hub(robot).machine.time_ms for robot in env.task.robots]
    assert len(set(clocks)) == 1
    before = env.world.poses()
    acted(env, state, catcher=[[1.0, 1.0]], runner=[[1.0, 1.0]])
    after = env.world.poses()
    later = [env.hub(robot).machine.time_ms for robot in env.task.robots]
    assert len(set(later)) == 1 and 250 <= later[0] - clocks[0] <= 350, (
        "one step for both, not one after the other"
    )
    for one, other in zip(before, after, strict=True):
        assert np.hypot(other.x_m - one.x_m, other.y_m - one.y_m) > 0.01
    env.close()


@pytest.mark.parametrize("batch", [[], [4]])
@pytest.mark.parametrize("shape", [[1, 1], [1, 3], [2, 2], [2]])
def test_actions_of_another_shape_raise(batch: list[int], shape: list[int]) -> None:
    env = make_arena("Tag-v0", seed=1, batch_size=sum(batch))
    state = env.reset()
    state["runner", "action"] = torch.zeros(*batch, 1, 2)
    state["catcher", "action"] = torch.zeros(*batch, 1, 2)
    env.step(state)
    told = f"catcher of Tag-v0 got an action of shape {[*batch, *shape]}; give {[*batch, 1, 2]}"
    with pytest.raises(BricksError, match=re.escape(told)):
        env.step(TensorDict({**state, "catcher": {"action": torch.zeros(*batch, *shape)}}, batch))
    env.close()


def test_arena_episode_is_reproducible() -> None:
    played = []
    for _ in range(2):
        env = make_arena("Tag-v0", seed=8)
        state, frames = env.reset(), []
        for step in range(6):
            state = acted(env, state, catcher=[[0.3 * step - 1, 1.0]], runner=[[1.0, -0.5]])
            frames.append(
                torch.cat([state[group, "observation"] for group in ("catcher", "runner")])
            )
        played.append(torch.stack(frames))
        env.close()
    assert torch.equal(*played)


def test_one_lost_link_ends_episode_until_reset() -> None:
    env = make_arena("Tag-v0", seed=1)
    state = acted(env, env.reset(), catcher=[[1.0, 1.0]], runner=[[1.0, 1.0]])
    seen = state["catcher", "observation"].clone()
    env.hub("runner").in_reach = lambda: False
    lost = acted(env, state, catcher=[[1.0, 1.0]], runner=[[1.0, 1.0]])
    assert [bool(lost[name]) for name in ("link_lost", "truncated", "done", "terminated")] == [
        True,
        True,
        True,
        False,
    ]
    assert (
        torch.equal(lost["catcher", "observation"], seen)
        and float(lost["catcher", "reward"]) == 0.0
    )
    assert isinstance(env.link_error, HubError)
    with pytest.raises(BricksError, match="reset the environment first"):
        acted(env, lost, catcher=[[1.0, 1.0]], runner=[[1.0, 1.0]])
    with pytest.raises(HubError, match="out of reach"):
        env.reset()
    env.hub("runner").in_reach = lambda: True
    state = acted(env, env.reset(), catcher=[[1.0, 1.0]], runner=[[1.0, 1.0]])
    assert not bool(state["link_lost"])
    env.close()


def test_robots_collide_and_see_each_other() -> None:
    def facing(x_m: float, heading_deg: float, name: str) -> Contestant:
        return Contestant(
            name, TWO_WHEELER, Place((x_m, x_m), (0.0, 0.0), (heading_deg, heading_deg))
        )

    world = ArenaWorld(Arena((facing(-0.25, 0.0, "a"), facing(0.25, 180.0, "b"))))
    world.place(np.random.default_rng(0))
    seen = [body.distance_mm("C") for body in world.bodies]
    assert all(abs(distance - 384) < 20 for distance in seen), (
        "half a metre between the axles, less twice 58 mm"
    )
    for body in world.bodies:
        body.set_voltage("E", -7000)
        body.set_voltage("A", 7000)
    world._advance_to(2500)
    a, b = world.poses()
    assert 0.09 < b.x_m - a.x_m < 0.2, "nose to nose"


def test_robots_have_all_of_their_sensors() -> None:
    bump = PoweredUpSensor("bump", "F", SensorKind.FORCE, Mount((90, 0, 28), "ahead"))
    robot = replace(SCOUT, sensors=(*SCOUT.sensors, bump))
    places = (Place(x_m=(-0.4, -0.4)), Place(x_m=(0.4, 0.4), heading_deg=(90.0, 90.0)))
    world = ArenaWorld(
        Arena(
            tuple(Contestant(name, robot, place) for name, place in zip("ab", places, strict=True)),
            half_size_m=(1, 0.3),
        )
    )
    world.place(np.random.default_rng(0))
    for body in world.bodies:
        brightness = body.sensed("B", Sense.SURFACE)
        assert isinstance(brightness, tuple) and brightness[2] > 50.0  # the floor
        assert body.sensed("F", Sense.FORCE) == 0.0
        for port, voltage_mv in (("E", -5000), ("A", 5000)):
            body.set_voltage(port, voltage_mv)
    world._advance_to(1200)
    forces = [body.sensed("F", Sense.FORCE) for body in world.bodies]
    assert forces[0] == 0.0 < forces[1]  # the second one pushes the wall at its right


def test_rods_of_walkers_are_drawn_between_their_pins() -> None:
    places = (Place(), Place(x_m=(0.5, 0.5)))
    world = ArenaWorld(
        Arena(
            tuple(Contestant(name, WALKER, place) for name, place in zip("ab", places, strict=True))
        )
    )
    world.place(np.random.default_rng(0))
    for body, voltage_mv in zip(world.bodies, (3000, -4000), strict=True):
        for motor in WALKER.motors:
            body.set_voltage(motor.port, voltage_mv)
    world._advance_to(400)
    world.bodies[0].update_visuals()
    rods = [f"{name}/rod_{motor.port}" for name in "ab" for motor in WALKER.motors]
    for rod in rods:
        drawn, pin = world.engine.data.body(rod), world.engine.data.site(f"{rod}_far")
        along = (pin.xpos - drawn.xpos) / np.linalg.norm(pin.xpos - drawn.xpos)
        assert drawn.xmat.reshape(3, 3)[:, 2] == pytest.approx(along, abs=1e-6)


def test_shafts_that_turn_only_visually_turn_with_their_own_robot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def geared(*args: Any, **kwargs: Any) -> mujoco.MjSpec:
        spec = load_model(*args, **kwargs)
        # turns twice as fast, about z
        spec.body("chassis").add_body(name="spin_A_0", userdata=[2.0, 0.0, 0.0, 1.0])
        return spec

    monkeypatch.setattr("bricktwin.twin.models.load.load_model", geared)
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)  # nothing that a test has changed is kept
    places = (Place(), Place(x_m=(0.5, 0.5)))
    world = ArenaWorld(
        Arena(
            tuple(
                Contestant(name, TWO_WHEELER, place)
                for name, place in zip("cd", places, strict=True)
            )
        )
    )
    for body, voltage_mv in zip(world.bodies, (3000, -4000), strict=True):
        body.set_voltage("A", voltage_mv)
    world._advance_to(300)
    world.bodies[0].update_visuals()
    for name in "cd":
        w, _, _, z = world.bodies[0].model.body(f"{name}/spin_A_0").quat
        joint = world.engine.data.joint(f"{name}/motor_A").qpos[0]
        assert abs(joint) > 0.3
        assert np.array([w, z]) == pytest.approx([np.cos(joint), np.sin(joint)])


def test_beam_needs_two_robots() -> None:
    env = make_arena("Carry-v0", seed=2)
    push = env.task.scripts["push"]

    def play(share: torch.Tensor) -> bool:
        state = env.reset()
        while not bool(state.get("done", torch.zeros(1))):
            state["agents", "action"] = push(state["agents", "observation"]) * share
            state = env.step(state)["next"]
        return bool(state["success"])

    assert play(torch.tensor([[1.0], [1.0]]))
    assert not play(torch.tensor([[1.0], [0.0]]))
    env.close()


def test_observations_are_in_robot_frame() -> None:
    poses = torch.tensor([[1.0, 2.0, torch.pi / 2], [1.0, 2.5, torch.pi]])
    assert torch.allclose(seen_from(poses, 0, 1), torch.tensor([0.5, 0.0, 0.0, 1.0]), atol=1e-6)
    assert torch.allclose(seen_from(poses, 1, 0), torch.tensor([0.0, 0.5, 0.0, -1.0]), atol=1e-6)


def test_tag_rewards_sum_to_zero() -> None:
    task = get_arena_task("Tag-v0")
    before = ArenaState(torch.tensor([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), torch.zeros(2, 2))
    after = ArenaState(torch.tensor([[0.35, 0.0, 0.0], [0.5, 0.0, 0.0]]), torch.zeros(2, 2))
    rewards = task.reward(before, after)
    assert torch.allclose(rewards, torch.tensor([[8.5], [-8.5]])) and bool(task.terminated(after))


def test_runner_script_outlasts_straight_escape() -> None:
    def mean_steps(script: Any) -> float:
        env = make_arena("Tag-v0", seed=1, batch_size=128)
        state, steps, free = env.reset(), torch.zeros(128, 1), torch.ones(128, 1, dtype=torch.bool)
        while bool(free.any()) and steps.max() < 80:
            state["catcher", "action"] = TAG.scripts["chase"](state["catcher", "observation"])
            state["runner", "action"] = script(state["runner", "observation"])
            steps += free
            state = env.step_mdp(env.step(state))
            free &= ~state["terminated"]
        return float(steps.mean())

    away = mean_steps(lambda seen: steer_towards(-seen[..., 4], -seen[..., 5]))
    assert mean_steps(TAG.scripts["flee"]) > away + 1.0 > 5.0


def test_simulation_matches_arena() -> None:
    """Equal commands lead to equal places within a few centimetres."""
    task = get_arena_task("Tag-v0")
    fixed = [Place((x_m, x_m), (0.0, 0.0), (0.0, 0.0)) for x_m in (-0.5, 0.2)]
    robots = tuple(
        replace(one, place=place) for one, place in zip(task.arena.robots, fixed, strict=True)
    )
    task = replace(task, arena=replace(task.arena, robots=robots, gap_m=0.1))
    ends = []
    for copies in (0, 16):
        env = make_arena(task, seed=1, batch_size=copies)
        state = env.reset()
        for _ in range(6):
            shape = (copies, 1, 2) if copies else (1, 2)
            state["catcher", "action"] = torch.tensor([0.6, 0.9]).expand(shape).clone()
            state["runner", "action"] = torch.tensor([0.9, 0.5]).expand(shape).clone()
            state = env.step(state)["next"]
        seen = torch.stack(
            [state[group, "observation"][..., 0, :2] for group in ("catcher", "runner")]
        )
        ends.append(seen.mean(1) if copies else seen)
    assert torch.allclose(*ends, atol=0.08)


WAYS_M = [math.radians(degrees) * 0.028 for degrees in (150.0, 112.0)]
"""Ways of catcher and runner in a step at full speed, with wheels of 56 mm."""


def exact(monkeypatch: pytest.MonkeyPatch, copies: int, lag: float = 0.0) -> Any:
    """Simulated copies of Tag-v0 without noise, with both robots in the middle."""
    monkeypatch.setattr(arena_env, "NOISE", 0.0)
    monkeypatch.setattr(arena_env, "LAG", (lag, lag))
    env = make_arena("Tag-v0", seed=1, batch_size=copies)
    env.reset()
    env._state.poses.zero_()
    return env


def driven(env: Any, catcher: list[float], runner: list[float]) -> torch.Tensor:
    """Poses of the first copy after a step."""
    copies = env.batch_size[0]
    frame = TensorDict({}, [copies])
    for group, wheels in (("catcher", catcher), ("runner", runner)):
        frame[group] = TensorDict({"action": torch.tensor(wheels).expand(copies, 1, 2)}, [copies])
    env.step(frame)
    return env._state.poses[0]


def test_simulated_robots_drive_along_the_chords_of_arcs(monkeypatch: pytest.MonkeyPatch) -> None:
    env = exact(monkeypatch, 1)
    track_m = TWO_WHEELER.drive_base.axle_track_mm / 1000
    catcher, runner = driven(env, [1.0, 1.0], [-0.5, 0.5])
    assert catcher.tolist() == pytest.approx([WAYS_M[0], 0.0, 0.0])
    assert runner.tolist() == pytest.approx([0.0, 0.0, WAYS_M[1] / track_m])
    turn = 0.5 * WAYS_M[0] / track_m
    catcher, _ = driven(env, [0.5, 1.0], [0.0, 0.0])
    way_m = 0.75 * WAYS_M[0]
    wanted = [WAYS_M[0] + way_m * math.cos(turn / 2), way_m * math.sin(turn / 2), turn]
    assert catcher.tolist() == pytest.approx(wanted)


def test_simulated_robots_slide_along_the_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    env = exact(monkeypatch, 1)
    most_m = 0.8 - arena_env.MARGIN_M
    env._state.poses[0] = torch.tensor([(0.72, 0.0, math.pi / 4), (0.1, -0.72, -math.pi / 2)])
    catcher, runner = driven(env, [1.0, 1.0], [1.0, 1.0])
    assert catcher[:2].tolist() == pytest.approx([most_m, WAYS_M[0] / math.sqrt(2)])
    assert runner[:2].tolist() == pytest.approx([0.1, -most_m])
    catcher, runner = driven(env, [-1.0, -1.0], [-1.0, -1.0])
    assert catcher[0] < most_m and runner[1] > -most_m


def test_simulated_motors_carry_out_a_part_of_a_command_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = exact(monkeypatch, 2, lag=0.25)
    ways_m = [driven(env, [share, share], [0.0, 0.0])[0, 0].item() for share in (1.0, 0.0, 0.0)]
    assert ways_m == pytest.approx([0.75 * WAYS_M[0], WAYS_M[0], WAYS_M[0]])
    driven(env, [1.0, 1.0], [-1.0, -1.0])
    assert env._state.moved[0].tolist() == [[0.75, 0.75], [-0.75, -0.75]]
    ended = torch.tensor([[True], [False]])
    before = env._state.poses.clone()
    env.reset(TensorDict({"_reset": ended}, [2]))
    assert torch.equal(env._state.poses[1], before[1]), "only what has ended begins anew"
    assert not torch.equal(env._state.poses[0], before[0])
    assert env._state.moved[:, 0].tolist() == [[0.0, 0.0], [0.75, 0.75]]
    start = env._state.poses.clone()
    driven(env, [0.0, 0.0], [0.0, 0.0])
    moved = (env._state.poses - start)[:, 0, :2].norm(dim=-1)
    assert moved.tolist() == pytest.approx([0.0, 0.25 * WAYS_M[0]], abs=1e-6)


def test_lags_and_noise_differ_from_copy_to_copy() -> None:
    env = make_arena("Tag-v0", seed=1, batch_size=2000)
    state = env.reset()
    low, high = arena_env.LAG
    lags = env._lag.flatten()
    assert low <= lags.min() < low + 0.01 and high - 0.01 < lags.max() <= high
    for group in ("catcher", "runner"):
        state[group, "action"] = torch.zeros(2000, 1, 2)
    env.step(state)
    assert env._state.moved.std().item() == pytest.approx(arena_env.NOISE, rel=0.05)
    assert env._state.moved.mean().abs() < 0.002


def test_invalid_arguments_raise() -> None:
    with pytest.raises(UnknownNameError, match="no arena 'Chess-v0'"):
        make_arena("Chess-v0")
    with pytest.raises(
        DescriptionError, match="no kinematic simulation, .* leave out batch_size, .* copies=0"
    ):
        make_arena("Carry-v0", batch_size=4)
    with pytest.raises(DescriptionError, match="omit realtime and physics"):
        make_arena("Tag-v0", batch_size=4, realtime=True)
    for wrong in (-1, [2, 3], "4"):
        with pytest.raises(
            DescriptionError,
            match=f"batch_size is {re.escape(repr(wrong))}; give a number of copies",
        ):
            make_arena("Tag-v0", batch_size=wrong)
    with pytest.raises(RunError, match="there is no device 'tpu'"):
        make_arena("Tag-v0", batch_size=2, device="tpu")
    with pytest.raises(DescriptionError, match="runs on the CPU; omit device"):
        make_arena("Tag-v0", device="cuda")
    place = Place()
    with pytest.raises(TwinError, match="a name of its own"):
        Arena((Contestant("a", TWO_WHEELER, place), Contestant("a", TWO_WHEELER, place)))
    with pytest.raises(TwinError, match="fixed base"):
        ArenaWorld(Arena((Contestant("arm", ROBO_ARM, place),)))


def test_robot_inside_a_wall_is_refused() -> None:
    world = ArenaWorld(
        Arena((Contestant("a", TWO_WHEELER, Place(x_m=(0.4, 0.4))),), half_size_m=(0.4, 0.4))
    )
    with pytest.raises(
        TwinError, match="would start inside of wall_0.*; narrow the place of the robot"
    ):
        world.place(np.random.default_rng(0))


@pytest.mark.parametrize("copies", [0, 3])
def test_robots_that_leave_no_room_for_one_another_raise(copies: int) -> None:
    inner = Place((-0.25, 0.25), (-0.25, 0.25))
    robots = tuple(Contestant(name, TWO_WHEELER, inner) for name in "abc")
    groups = {"all": ("a", "b", "c")}
    task = replace(
        TAG,
        arena=Arena(robots, gap_m=0.6),
        interfaces=(TAG.interfaces[0],) * 3,
        groups=groups,
        opponents={},
    )
    env = make_arena(task, seed=0, batch_size=copies)
    with pytest.raises(
        TwinError,
        match=r"no starts were found where a, b, c are 0.6 m apart; give them other places",
    ):
        env.reset()


def test_first_robot_does_not_take_the_others_room_for_ever() -> None:
    place = Place((-0.4, 0.4), (-0.4, 0.4))
    world = ArenaWorld(
        Arena(tuple(Contestant(name, TWO_WHEELER, place) for name in "ab"), gap_m=0.8)
    )
    for seed in range(3):
        world.place(np.random.default_rng(seed))
        one, other = world.poses()
        assert np.hypot(one.x_m - other.x_m, one.y_m - other.y_m) >= 0.8


def test_starts_of_simulation_are_turned_as_in_the_arena() -> None:
    places = [Place((x_m, x_m), (0.0, 0.0), (80.0, 100.0)) for x_m in (-0.5, 0.5)]
    robots = tuple(
        replace(one, place=place) for one, place in zip(TAG.arena.robots, places, strict=True)
    )
    task = replace(TAG, arena=replace(TAG.arena, robots=robots))
    for copies in (0, 5):
        state = make_arena(task, seed=0, batch_size=copies).reset()
        assert torch.allclose(
            state["runner", "observation"][..., 3], torch.tensor(-1.0), atol=0.02
        ), "clockwise, seen from above"


def test_each_robot_has_its_own_order_of_channels() -> None:
    one, other = TAG.interfaces
    task = replace(
        TAG, interfaces=(one, replace(other, channels=(Pitch(), *reversed(other.channels))))
    )
    moved = []
    for chosen in (TAG, task):
        env = make_arena(chosen, seed=0)
        moved.append(
            acted(env, env.reset(), catcher=[[0.0, 0.0]], runner=[[1.0, -0.5]])[
                "runner", "observation"
            ][0, -2:]
        )
        env.close()
    assert torch.allclose(*moved, atol=0.02) and moved[0][0] > 0.5 > 0.0 > moved[0][1]


@pytest.mark.parametrize(
    "commands",
    [
        tuple(RunAngle(name, -90, 90, 500) for name in ("right", "left")),
        tuple(RunAngle(name, 0, 90, 500) for name in ("left", "right")),
        (DriveStraight(-90, 90), DriveTurnRate(-90, 90)),
    ],
)
def test_arena_commands_the_left_and_the_right_wheel(commands: tuple[Command, ...]) -> None:
    interface = replace(TAG.interfaces[0], commands=commands)
    with pytest.raises(
        DescriptionError, match="RunAngle of the left and of the right wheel, as far back as forth"
    ):
        replace(TAG, interfaces=(interface, interface))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (
            {"reward": lambda state: state},
            r"reward of Tag-v0 takes other arguments, \(state\); write .* \(before, after\)",
        ),
        (
            {"observe": lambda: 0},
            r"observe of Tag-v0 takes other arguments, \(\); write a function of \(state\)",
        ),
        ({"scripts": {"flee": lambda: 0}}, "script 'flee' of Tag-v0 takes other arguments"),
        ({"success": True}, "success is True; give a function"),
        (
            {"opponents": {"runer": "flee"}},
            "opponents names 'runer', which is no group .did you mean 'runner'",
        ),
        ({"opponents": {"runner": "fly"}}, "there is no script 'fly'; choose random, flee, chase"),
        ({"opponents": {"runner": "flee,fly"}}, "there is no script 'fly'"),
        ({"id": "Tag"}, "'Tag' is not an id for a task; take a name and a version"),
        ({"interfaces": TAG.interfaces[:1]}, "Tag-v0 has 2 robots and 1 interfaces; give one each"),
        ({"interfaces": TAG.interfaces * 2}, "Tag-v0 has 2 robots and 4 interfaces; give one each"),
        ({"groups": {"all": ("runner",)}}, "each of .*runner.* belongs to one group; name it"),
        (
            {"groups": {**TAG.groups, "all": ("runner",)}},
            "each of .*runner.* belongs to one group; name it",
        ),
        ({"groups": {"all": ("runner", "catchr")}}, "each of .*catcher.* belongs to one group"),
        ({"told": -1}, "told is -1; give a whole number from 0 to 6"),
    ],
)
def test_task_with_unfitting_parts_is_refused(wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(DescriptionError, match=told):
        replace(TAG, **wrong)


@pytest.mark.parametrize("copies", [0, 2])
@pytest.mark.parametrize("name", ["observe", "reward", "terminated", "success"])
def test_functions_that_return_another_shape_are_named(name: str, copies: int) -> None:
    task = replace(TAG, **{name: lambda *states: states[0].poses[..., 0, 0]})
    env = make_arena(task, seed=0, batch_size=copies)
    with pytest.raises(
        DescriptionError, match=f"{name} of Tag-v0 is of shape .*; compute a tensor of shape"
    ):
        env.rollout(2)
    env.close()
