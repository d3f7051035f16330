"""Robots that tell one another numbers: from hub to hub, in the arena and in the simulation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

from brickhub.hub.messages import HeardNumber, TellNumber
from brickhub.virtual.air import INTERVAL_MS
from bricksrl.envs.arenas import get_arena_task, make_arena
from bricksrl.envs.arenas.arena_task import ArenaState
from bricksrl.envs.arenas.guide import DRIVER, GATE, GUIDE, HALF_GATE_M, LINE_M, observe
from bricksrl.envs.arenas.simulated_air import SimulatedAir
from bricksrl.errors import DescriptionError

HEARD = slice(6, 8)


def told(env: Any, state: Any, numbers: list[list[float]]) -> torch.Tensor:
    """What guide and driver have heard after they stood still for a step and told numbers."""
    actions = torch.zeros(*env.batch_size, 2, 4)
    actions[..., 2:] = torch.tensor(numbers)
    state["agents", "action"] = actions
    heard: torch.Tensor = env.step(state)["next"]["agents", "observation"][..., HEARD]
    return heard


@pytest.mark.parametrize("copies", [0, 3])
@pytest.mark.parametrize("deaf", [False, True])
def test_what_one_robot_tells_the_other_hears_unless_it_is_deaf(copies: int, deaf: bool) -> None:
    env = make_arena("Guide-v0", seed=2, batch_size=copies, deaf=deaf)
    state = env.reset()
    assert bool((state["agents", "observation"][..., HEARD] == 0.0).all()), "a new episode is quiet"
    for guide in (0.5, -0.25):
        heard = told(env, state, [[guide, 1.0], [0.0, -1.0]])
        wanted = torch.tensor([[0.0, -1.0], [guide, 1.0]]) * (not deaf)
        assert torch.allclose(heard, wanted.expand_as(heard), atol=1e-6)
    env.reset()
    env.close()


def test_what_robots_tell_goes_from_hub_to_hub() -> None:
    env = make_arena("Guide-v0", seed=2)
    state = env.reset()
    assert told(env, state, [[1.0, 1.0], [1.0, 1.0]])[DRIVER].tolist() == [1.0, 1.0]
    assert env.hub("guide").machine.antenna.changes[-1][1:] == (GUIDE, (100, 100))
    # The air between the hubs is all that is taken away.
    env.world.on_time.clear()
    heard = [told(env, state, [[1.0, 1.0], [1.0, 1.0]]).tolist() for _ in range(4)]
    assert heard[0] == [[1.0, 1.0]] * 2, "what was heard counts for a second"
    assert heard[-1] == [[0.0, 0.0]] * 2
    env.close()


def test_driver_does_not_see_the_gate() -> None:
    poses = torch.tensor([[-0.7, 0.0, 0.0], [0.1, 0.0, 1.0]]).expand(4, 2, 3)
    drawn = torch.tensor([[-0.5], [-0.2], [0.1], [0.4]])
    state = ArenaState(poses, torch.zeros(4, 2, 2), torch.zeros(4, 2, 2), drawn)
    seen = observe(state)
    assert torch.equal(seen[:, GUIDE, 5:6], drawn)
    assert bool((seen[:, DRIVER] == seen[0, DRIVER]).all())


def test_only_the_gate_is_a_success() -> None:
    poses = torch.zeros(3, 2, 3)
    poses[0, DRIVER, :2] = torch.tensor([LINE_M, 0.9 * HALF_GATE_M])
    poses[1, DRIVER, :2] = torch.tensor([LINE_M, 1.1 * HALF_GATE_M])
    state = ArenaState(poses, torch.zeros(3, 2, 2), torch.zeros(3, 2, 2), torch.zeros(3, 1))
    before = replace(state, poses=torch.zeros(3, 2, 3))
    assert GATE.terminated(state).flatten().tolist() == [True, True, False]
    assert GATE.success(state).flatten().tolist() == [True, False, False]
    rewards = GATE.reward(before, state)
    assert torch.equal(rewards[:, GUIDE], rewards[:, DRIVER])
    nearer_m = LINE_M - torch.tensor([0.9, 1.1, 0.0]) * HALF_GATE_M
    nearer_m[2] = 0.0
    wanted = 10.0 * nearer_m + torch.tensor([5.0, 0.0, 0.0])
    assert torch.allclose(rewards[:, DRIVER, 0], wanted)


def test_script_needs_what_the_other_robot_tells() -> None:
    ends = {}
    for deaf in (False, True):
        env = make_arena("Guide-v0", seed=1, batch_size=32, deaf=deaf)
        state = env.reset()
        succeeded = torch.zeros(32, 1, dtype=torch.bool)
        for _ in range(25):
            state["agents", "action"] = GATE.scripts["follow"](state["agents", "observation"])
            frame = env.step(state)
            succeeded |= frame["next", "success"]
            state = env.step_mdp(frame)
        ends[deaf] = int(succeeded.sum())
    assert ends == {False: 32, True: 0}


def test_simulated_air_is_late_and_loses_as_the_hubs_air_does() -> None:
    """A number that changes in each step is mostly heard in it; with steps shorter than the
    interval of broadcasts often the one before is."""
    fresh = {}
    for step_ms in (250, 60):
        air = SimulatedAir(copies=40, robots=2, told=1, step_ms=step_ms, seed=3)
        heard = []
        for step in range(20):
            told_now = step / 100
            heard.append((air.step(torch.full((40, 2, 1), told_now)) - told_now).abs() < 1e-3)
        fresh[step_ms] = float(torch.stack(heard).float().mean())
    assert step_ms < INTERVAL_MS and fresh[60] < 0.75 < 0.97 < fresh[250] <= 1.0


def test_each_robot_hears_all_others() -> None:
    air = SimulatedAir(copies=1, robots=3, told=2, step_ms=500, seed=0)
    numbers = torch.tensor([[[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]])
    heard = air.step(numbers)
    wanted = [[0.3, 0.4, 0.5, 0.6], [0.1, 0.2, 0.5, 0.6], [0.1, 0.2, 0.3, 0.4]]
    assert torch.allclose(heard, torch.tensor([wanted]))


def test_a_task_declares_how_much_its_robots_tell() -> None:
    for told_numbers in (0, 1, 3):
        task = replace(GATE, told=told_numbers)
        assert task.action_size == 2 + told_numbers and task.heard_size == told_numbers
        for interface in task.interfaces:
            kinds = [type(number) for number in (*interface.commands, *interface.channels)]
            assert kinds.count(TellNumber) == kinds.count(HeardNumber) == told_numbers
    with pytest.raises(DescriptionError, match="told is 7; give a whole number from 0 to 6"):
        replace(GATE, told=7)
    with pytest.raises(DescriptionError, match="robots of Tag-v0 tell one another nothing; omit"):
        make_arena("Tag-v0", deaf=True)


@pytest.mark.parametrize("copies", [0, 4])
def test_gate_is_drawn_anew_in_each_episode(copies: int) -> None:
    task = get_arena_task("Guide-v0")
    gates = []
    env = make_arena(task, seed=5, batch_size=copies)
    for _ in range(4):
        seen = env.reset()["agents", "observation"].reshape(-1, 2, 10)
        gates += seen[:, GUIDE, 5].tolist()
    env.close()
    assert len(set(gates)) == len(gates) and all(-0.5 <= gate <= 0.5 for gate in gates)
    assert max(gates) - min(gates) > 0.1


def test_gate_is_seen_where_it_was_drawn() -> None:
    env = make_arena("Guide-v0", seed=2)
    places = []
    for _ in range(2):
        gate = env.reset()["agents", "observation"][GUIDE, 5].item()
        data = env.world.bodies[0].data
        assert data.body("gate").xpos[:2].tolist() == pytest.approx([LINE_M, gate])
        posts = [data.body(f"{side}_post").xpos[1] for side in ("left", "right")]
        assert posts == pytest.approx([gate + HALF_GATE_M, gate - HALF_GATE_M])
        places.append(gate)
    assert places[0] != places[1]
    model = env.world.bodies[0].model
    geoms = [model.body(mark.name).geomadr[0] for mark in GATE.arena.marks]
    assert not any(model.geom_contype[geoms]), "robots drive through them"
    env.close()


def test_marks_and_their_places_belong_together() -> None:
    with pytest.raises(DescriptionError, match="give both or none"):
        replace(GATE, mark=None)
    with pytest.raises(DescriptionError, match="give both or none"):
        replace(get_arena_task("Tag-v0"), mark=GATE.mark)
