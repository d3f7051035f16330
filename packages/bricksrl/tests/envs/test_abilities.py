"""What drawn robots can learn: tasks of plans, refusals with what a robot lacks, and that they
work."""

from __future__ import annotations

import math
import shutil
from contextlib import closing
from pathlib import Path

import pytest
import torch

import bricksrl
from brickhub.hub.interface import DriveSpeed, DriveStraight, RunAngle
from brickhub.hub.program.generate import generate_alone
from brickhub.search.approach import approach
from brickhub.search.structure import source_by
from brickhub.search.upright import upright
from brickhub.user_files import load_object
from bricksrl.agents import make_learner
from bricksrl.agents.search import structures
from bricksrl.agents.search.structures import make_structure
from bricksrl.envs import get_task
from bricksrl.envs.abilities import driving
from bricksrl.envs.abilities.of_plans import offers
from bricksrl.envs.env_checker import check_env
from bricksrl.envs.registry import LABELS
from bricksrl.envs.rollout import play_episodes
from bricksrl.errors import BricksError, DescriptionError, UnknownNameError
from bricksrl.policies.hub_export import play_alone
from bricksrl.target import find
from bricksrl.training.config import TrainConfig, settings_for
from bricksrl.training.learners import on_its_hub
from bricktwin.robots import plans
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene

PLANS = Path(plans.__path__[0])
EXAMPLES = Path(__file__).parents[4] / "examples"
CAN = {
    PLANS / "two_wheeler.ldr": {"park", "stop", "away", "spin"},
    PLANS / "ev3_driver.ldr": {"line", "park", "stop", "away", "spin"},
    PLANS / "walker.ldr": {"walk"},
    PLANS / "robo_arm.ldr": {"reach"},
    EXAMPLES / "13_front_steered.ldr": {"ahead"},
    EXAMPLES / "15_six_legs.ldr": {"walk"},
    EXAMPLES / "drawings" / "balancer.ldr": {"upright"},
}


@pytest.mark.parametrize("path", CAN, ids=lambda path: path.stem)
def test_robots_are_offered_what_they_can(path):
    offered = offers(robot_as_drawn(path))
    assert {offer.ability.name for offer in offered if offer.task is not None} == CAN[path]
    # Whatever is not offered has a reason, in words that go on after a colon.
    for offer in offered:
        assert (offer.reason != "") == (offer.task is None)
        assert not offer.reason.endswith(".")


ONE_EACH = {goal: path for path, goals in CAN.items() for goal in goals}
"""A robot for each goal; several can learn the same."""


@pytest.mark.parametrize(("goal", "file"), sorted(ONE_EACH.items()), ids=sorted(ONE_EACH))
def test_each_goal_is_a_task_that_plays(goal, file):
    env = bricksrl.make(f"{file}:{goal}", seed=0)
    frames = env.rollout(3)
    assert bool(torch.isfinite(frames["next", "reward"]).all())
    env.close()


def test_task_of_a_plan_passes_the_checks_of_environments():
    findings = list(check_env(f"{PLANS / 'two_wheeler.ldr'}:stop"))
    assert [finding for finding in findings if finding.outcome.value == "error"] == []


def test_commands_are_those_of_the_robot():
    wheels = get_task(f"{PLANS / 'two_wheeler.ldr'}:away").interface.commands
    assert [type(command) for command in wheels] == [DriveStraight]
    stop = get_task(f"{PLANS / 'two_wheeler.ldr'}:stop").interface.commands
    assert [type(command) for command in stop] == [DriveSpeed]
    car = get_task(f"{EXAMPLES / '13_front_steered.ldr'}:ahead").interface.commands
    assert [(type(command), command.name) for command in car] == [(RunAngle, "drive")]


def test_a_walk_of_a_drawing_is_paid_by_its_way_and_ends_where_it_falls():
    task = get_task(f"{PLANS / 'walker.ldr'}:walk")
    names = [entry.name for entry in task.entries]
    assert names[4:] == ["pitch", "roll", "forward"]

    def rows(*about: tuple[float, float, float]) -> torch.Tensor:
        return torch.tensor([[300.0, 300.0, 300.0, 300.0, *tail] for tail in about])

    seen = rows((0.0, 0.0, 10.0), (60.0, -60.0, -20.0), (61.0, 0.0, 0.0), (0.0, -61.0, 40.0))
    assert task.reward(seen, torch.zeros(4, 4), seen)[:, 0].tolist() == [0.5, -1.0, 0.0, 2.0]
    assert task.terminated(seen)[:, 0].tolist() == [False, False, True, True]
    assert task.metrics(seen)["mean_step_mm"].item() == 7.5
    # 30 mm a second.
    fast_mm = 0.03 * task.interface.settle.longest_ms
    assert bool(task.success(rows((0.0, 0.0, 0.5 * fast_mm), (0.0, 0.0, 1.6 * fast_mm))))
    assert not bool(task.success(rows((0.0, 0.0, 0.5 * fast_mm), (0.0, 0.0, 1.4 * fast_mm))))
    assert not bool(task.success(rows((61.0, 0.0, fast_mm), (0.0, 0.0, 2 * fast_mm))))


def test_a_walker_is_mirrored_if_all_of_its_legs_have_an_image():
    file = EXAMPLES / "walkers" / "two_legs.ldr"
    assert get_task(f"{file}:walk").symmetric
    car = EXAMPLES / "13_front_steered.ldr"
    assert not get_task(f"{car}:ahead").symmetric


def test_line_starts_where_the_sensor_is_over_its_edge():
    env = bricksrl.make(f"{PLANS / 'ev3_driver.ldr'}:line", seed=0)
    first = env.reset()["observation"]
    # Between the reflection of the line and that of the floor, which are 5 and 71 %.
    assert 8 < float(first[0]) < 68
    env.close()


ROVER = EXAMPLES / "drawings" / "rover.ldr"


def turned_round(tmp_path: Path) -> Path:
    """The rover with its distance sensor on the other side, so that it drives the other way, and
    its color sensor goes 16 mm behind its wheels."""
    lines: list[str] = []
    is_sensor = False
    # Only a plan that says no ports is turned to where its robot drives.
    for line in ROVER.read_text(encoding="utf-8").splitlines():
        is_sensor = line.startswith("0 // Distance") or (is_sensor and line != "0 STEP")
        words = line.split()
        if "PORT" in words:
            continue
        if is_sensor and words[0] == "1":
            # Half a turn about the vertical negates x and z, of the place and of each direction.
            for place in (2, 4, 5, 6, 7, 11, 12, 13):
                words[place] = f"{-float(words[place]):g}"
        lines.append(" ".join(words))
    path = tmp_path / "turned.ldr"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("is_turned", [False, True], ids=["ahead", "behind"])
def test_a_line_is_followed_with_the_sensor_ahead_of_the_wheels(is_turned, tmp_path):
    path = turned_round(tmp_path) if is_turned else ROVER
    (offer,) = [one for one in offers(robot_as_drawn(path)) if one.ability.name == "line"]
    assert offer.remark.startswith("backwards, as its color sensor is 16 mm behind") is is_turned
    reference = f"{path}:line"
    speed = get_task(reference).interface.commands[0]
    assert (speed.low, speed.high) == ((-100, -40) if is_turned else (40, 100))
    with closing(bricksrl.make(reference, seed=0)) as env:
        learner = make_learner("gait", env, settings_for(reference, "default", "gait"))
        learner.actor.best.copy_(torch.tensor([math.copysign(70.0, speed.low), 2.5, 0.6]))
        on_its_hub(learner, env)
        (score,) = play_episodes(env, learner.exploit, 1, seed=0)
    assert score.success
    # Faster is better in both directions, and the edge is as near.
    assert score.return_ > 40.0


def test_an_edge_is_followed_by_the_same_numbers_in_a_batch():
    with closing(bricksrl.make("LineFollow-v0", seed=0)) as env:
        structure = make_structure(env, "edge")
    observed = torch.tensor([[60.0, 0.0], [20.0, -30.0], [38.0, 12.0]])
    numbers = torch.tensor([55.0, 1.5, 0.5])
    shares = structure(observed, numbers.expand(3, -1))
    for seen, share in zip(observed.tolist(), shares, strict=True):
        assert share.tolist() == pytest.approx(structure.single.act(seen, numbers.tolist()))


def test_an_approach_and_a_balance_are_the_same_numbers_in_a_batch():
    generator = torch.Generator().manual_seed(5)
    stop = f"{PLANS / 'two_wheeler.ldr'}:stop"
    for reference, of_batch, of_one in (
        (stop, structures.Approach, approach),
        (BALANCER, structures.Upright, upright),
    ):
        structure = of_batch(of_one(get_task(reference).interface))
        columns = len(get_task(reference).entries)
        low = torch.tensor([number.low for number in structure.numbers])
        high = torch.tensor([number.high for number in structure.numbers])
        share = torch.rand((6, len(low)), generator=generator)
        numbers = low + share * (high - low)
        observed = 400.0 * torch.rand((6, columns), generator=generator)
        shares = structure(observed, numbers).clamp(-1.0, 1.0)
        for seen, one, found in zip(
            observed.tolist(), numbers.tolist(), shares.tolist(), strict=True
        ):
            single = [min(max(act, -1.0), 1.0) for act in structure.single.act(seen, one)]
            assert found == pytest.approx(single, abs=1e-4)


def test_who_sees_no_line_follows_no_edge():
    with (
        closing(bricksrl.make("RunAway-v0", seed=0)) as env,
        pytest.raises(DescriptionError, match="observes the reflection of a line first"),
    ):
        make_structure(env, "edge")


@pytest.mark.parametrize(
    ("ahead_mm", "says"),
    [
        (4.0, "hard, as its color sensor is 4 mm ahead of its wheels, where turns hardly move it"),
        (30.0, ""),
        (-30.0, "backwards, as its color sensor is 30 mm behind its wheels"),
        (120.0, "hard, as its color sensor is 120 mm ahead of its wheels and 8 mm above the floor"),
    ],
)
def test_what_the_place_of_a_sensor_makes_of_a_line_is_said_before(monkeypatch, ahead_mm, says):
    monkeypatch.setattr(driving, "_place_mm", lambda drawn, sensor: (ahead_mm, 0.0, 8.0))
    remark = driving.remark_on_line(robot_as_drawn(ROVER))
    assert remark.startswith(says)
    assert bool(remark) is bool(says)


def test_runs_have_an_absolute_path_and_an_agent_that_suits(monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    from bricksrl.cli.train import Train

    config = Train("15_six_legs.ldr:walk").config("15_six_legs.ldr:walk")
    assert config.env == f"{EXAMPLES / '15_six_legs.ldr'}:walk"
    assert (config.agent, config.episodes) == ("gait", 3)
    assert TrainConfig(f"{PLANS / 'two_wheeler.ldr'}:spin").agent == "sac"


@pytest.mark.parametrize(
    ("reference", "kind", "says"),
    [
        ("{walker}", UnknownNameError, "name what its robot is to learn"),
        ("{walker}:wlak", UnknownNameError, r"did you mean 'walk'"),
        (
            "{walker}:park",
            DescriptionError,
            "cannot learn to park in a bay: no motor turns a wheel",
        ),
        ("nowhere.ldr:walk", BricksError, "nowhere.ldr"),
    ],
)
def test_what_a_plan_cannot_is_refused_with_the_reason(reference, kind, says):
    with pytest.raises(kind, match=says):
        get_task(reference.format(walker=PLANS / "walker.ldr"))


def test_what_a_plan_learns_is_no_code(tmp_path, monkeypatch):
    # A package beside the plan has its name, and must not be run.
    package = tmp_path / "rover"
    package.mkdir()
    for name in ("__init__.py", "ldr.py"):
        (package / name).write_text("raise RuntimeError('run')", encoding="utf-8")
    shutil.copy(PLANS / "walker.ldr", tmp_path / "rover.ldr")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert get_task("rover.ldr:walk").id == "Walk-v0"
    assert find("rover.ldr:walk").name == "Walk-v0"
    assert "rover.ldr:walk" in LABELS
    with pytest.raises(UnknownNameError, match="which is no Python file"):
        load_object("rover.ldr:walk", "AGENT")


def test_a_stop_is_best_at_150_mm_and_thrice_as_bad_too_near():
    task = get_task(f"{PLANS / 'two_wheeler.ldr'}:stop")

    def reward(distance_mm: float) -> float:
        seen = torch.tensor([[distance_mm]])
        return task.reward(seen, torch.zeros(1, 1), seen).item()

    assert reward(150.0) == 1.0
    assert reward(350.0) == pytest.approx(1 / 3, abs=0.05)
    for off_mm in (10.0, 40.0):
        assert reward(150.0 - off_mm) == pytest.approx(reward(150.0 + 3 * off_mm))
    stops = [torch.tensor([[900.0], [mm]]) for mm in (99.0, 101.0, 199.0, 201.0)]
    assert [bool(task.success(stop)) for stop in stops] == [False, True, True, False]
    assert task.metrics(stops[0])["final_off_mm"].item() == -51.0


BALANCER = f"{EXAMPLES / 'drawings' / 'balancer.ldr'}:upright"
STANDS = (0.0, 25.0, 0.05, 0.02, 0.015)
"""Lean, gain, time ahead, and shares of angle and speed, by which the balancer stands."""


def test_balancer_stands_by_a_program_of_its_own_and_falls_without():
    task = get_task(BALANCER)
    lengths = []
    for numbers in (STANDS, (0.0, 2.0, 0.0, 0.0, 0.0)):
        source = source_by(upright(task.interface), numbers)
        program = generate_alone(task.robot, task.interface, range(4), source, "numbers", 0)
        lengths.append(play_alone(program.source, task, None, 1).length)
    assert lengths[0] == task.max_steps
    assert lengths[1] < 100


def test_who_balances_is_paid_for_staying_and_judged_by_its_falls():
    task = get_task(BALANCER)
    # Lean, rate, angle and speed of the wheels, all in degrees.
    seen = torch.tensor([[lean, 9.0, turn, 9.0] for lean, turn in ((0, 0), (35, -360), (-36, 9e5))])
    rewards = task.reward(seen, torch.zeros(3, 2), seen)[:, 0].tolist()
    assert rewards == pytest.approx([1.0, 0.5 + 0.5 * math.exp(-1), 0.5])
    assert task.terminated(seen)[:, 0].tolist() == [False, False, True]
    assert (bool(task.success(seen[:2])), bool(task.success(seen))) == (True, False)
    assert task.metrics(seen)["upright_s"].item() == pytest.approx(0.04)
    assert task.metrics(seen[2:])["upright_s"].item() == 0.0


def test_balancer_is_held_until_its_motors_turn():
    body = make_body(get_task(BALANCER).robot, scene=Scene(held_deg=(3.0, 3.0)))
    assert body.tilt_deg()[0] == pytest.approx(3.0, abs=1.0)
    body.advance_to(2000)
    assert body.tilt_deg()[0] == pytest.approx(3.0, abs=1.0)
    body.set_voltage("A", 0)
    body.advance_to(4000)
    assert body.tilt_deg()[0] > 30.0


def test_balance_is_evaluated_on_the_hub():
    with closing(bricksrl.make(BALANCER, seed=0)) as env:
        learner = make_learner("gait", env, settings_for(BALANCER, "default", "gait"))
        learner.actor.best.copy_(torch.tensor(STANDS))
        on_its_hub(learner, env)
        (score,) = play_episodes(env, learner.exploit, 1, seed=0)
    assert score.success
    assert score.length == 250
