"""Numbers around a task: poses on the floor, entries and goals, texts of the registry, and
simulations, against independent formulas."""

from __future__ import annotations

import dataclasses
import logging
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import bricksrl
from brickhub.entry import Entry
from brickhub.hub.interface import (
    DriveSpeed,
    DriveTurnRate,
    Interface,
    MotorAngle,
    UntilDone,
    Wait,
)
from bricksrl.envs import registry
from bricksrl.envs.episode_state import EpisodeState
from bricksrl.envs.host_sensors.host_sensor import HostSensor
from bricksrl.envs.hub_policy import by_steps_because, most_steps
from bricksrl.envs.odometry import (
    FloorPose,
    SonarOdometer,
    Target,
    TargetTracker,
    TrueOdometer,
    start_pose,
)
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import get_task, list_envs, simulation_text, training_episodes
from bricksrl.envs.robot_env import chance_of
from bricksrl.envs.rollout import Rollout
from bricksrl.envs.simulation import SimulatedEnv, resolve_device
from bricksrl.envs.specs import (
    SpecsEnv,
)
from bricksrl.envs.task import Kinematics, SampledEntry, metrics_of, success_of
from bricksrl.envs.tasks.park import PARK
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.vision.camera import CameraView, VisualGoal
from bricksrl.errors import DescriptionError, RunError, UnknownOptionError
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.scene import Goal, Scene
from bricktwin.twin.standing import Pose

# ---------------------------------------------------------------- poses on the floor

MM = st.floats(-500.0, 500.0)
DEG = st.floats(-180.0, 180.0)


@settings(max_examples=30)
@given(x_mm=MM, y_mm=MM, heading_deg=DEG, way_mm=MM, turn_deg=st.floats(-300.0, 300.0))
def test_an_arc_is_many_small_straight_ways(
    x_mm: float, y_mm: float, heading_deg: float, way_mm: float, turn_deg: float
) -> None:
    """Headings are clockwise, and y points to the left."""
    end = FloorPose(x_mm, y_mm, heading_deg).driven(way_mm, turn_deg)
    count = 2000
    middles = (np.arange(count) + 0.5) / count
    headings = np.radians(heading_deg + turn_deg * middles)
    x_mm += way_mm * np.cos(headings).mean()
    y_mm -= way_mm * np.sin(headings).mean()
    assert (end.x_mm, end.y_mm) == pytest.approx((x_mm, y_mm), abs=1e-3)
    assert end.heading_deg == heading_deg + turn_deg


@settings(max_examples=30)
@given(x_mm=MM, y_mm=MM, heading_deg=DEG, ahead_mm=MM, left_mm=MM, turn_deg=st.floats(-179, 179))
def test_a_pose_is_seen_where_it_was_put(
    x_mm: float, y_mm: float, heading_deg: float, ahead_mm: float, left_mm: float, turn_deg: float
) -> None:
    robot = FloorPose(x_mm, y_mm, heading_deg)
    ahead = math.radians(-heading_deg)
    to_the_left = ahead + math.pi / 2
    put = FloorPose(
        x_mm + ahead_mm * math.cos(ahead) + left_mm * math.cos(to_the_left),
        y_mm + ahead_mm * math.sin(ahead) + left_mm * math.sin(to_the_left),
        heading_deg + turn_deg,
    )
    assert put.seen_from(robot) == pytest.approx((ahead_mm, left_mm, turn_deg), abs=1e-6)


def test_a_target_adds_five_entries_of_which_two_are_of_the_last_step() -> None:
    found = []
    for entry in Target(range_mm=150.0, range_deg=45.0, step_mm=15.0, step_deg=9.0).entries:
        assert entry.low == -entry.high and entry.limits is not None
        found.append((entry.name, entry.high, entry.unit, entry.limits))
    far_mm, around_deg = (-1e5, 1e5), (-180.0, 180.0)
    assert found == [
        ("target_ahead", 150.0, "mm", far_mm),
        ("target_left", 150.0, "mm", far_mm),
        ("target_turn", 45.0, "deg", around_deg),
        ("moved", 15.0, "mm", far_mm),
        ("turned", 9.0, "deg", around_deg),
    ]
    assert [entry.high for entry in Target().entries] == [200.0, 200.0, 60.0, 20.0, 12.0]


ROLLING = Interface((DriveSpeed(-1, 1),), (MotorAngle("left"), MotorAngle("right")), Wait(100))


def test_a_reckoned_robot_knows_its_target_and_a_twin_the_truth() -> None:
    poses = [Pose(0.3, -0.1, 30.0)]
    tracker = TargetTracker(
        Target(FloorPose(400.0, 0.0, 10.0)),
        TWO_WHEELER,
        ROLLING,
        lambda: poses[-1],
        FloorPose(300.0, -100.0, 30.0),
        [0.0, 0.0],
    )
    assert tracker.metrics() == pytest.approx(
        {"reckoning_error_mm": 0.0, "reckoning_error_deg": 0.0}, abs=1e-9
    )
    # The left wheel rolls half a turn less a degree, the right one back by a quarter.
    tracker.follow([179.0, 270.0])
    wheel_mm = math.pi * 56.0 / 360.0
    moved_mm = (179.0 - 90.0) / 2 * wheel_mm
    turned_deg = math.degrees((179.0 + 90.0) * wheel_mm / 130.0)
    reckoned = FloorPose(300.0, -100.0, 30.0).driven(moved_mm, turned_deg)
    seen = FloorPose(400.0, 0.0, 10.0).seen_from(reckoned)
    assert tracker.entries() == pytest.approx((*seen, moved_mm, turned_deg))
    poses.append(Pose(0.303, -0.096, 33.0))
    truth = FloorPose(400.0, 0.0, 10.0).seen_from(FloorPose(303.0, -96.0, 33.0))
    assert tracker.truth() == pytest.approx((*truth, moved_mm, turned_deg))
    errors = tracker.metrics()
    apart_mm = math.hypot(reckoned.x_mm - 303.0, reckoned.y_mm + 96.0)
    assert errors["reckoning_error_mm"] == pytest.approx(apart_mm)
    assert errors["reckoning_error_deg"] == pytest.approx(abs(reckoned.heading_deg - 33.0))


def test_a_real_robot_is_asked_to_be_put_in_words(caplog: pytest.LogCaptureFixture) -> None:
    scene = Scene(start_mm=((-300.0, -300.0), (40.0, 40.0)), heading_deg=(-12.0, -12.0))
    rng = np.random.default_rng(0)
    with caplog.at_level(logging.WARNING):
        assert start_pose(scene, "Mine-v0", None, rng) == FloorPose(-300.0, 40.0, -12.0)
    assert caplog.messages == [
        "Mine-v0: put the robot at x = -300 mm, y = 40 mm, turned by -12 degrees clockwise"
    ]
    virtual = start_pose(scene, "Mine-v0", lambda: Pose(0.25, -0.5, 7.0), rng)
    assert virtual == FloorPose(250.0, -500.0, 7.0) and len(caplog.messages) == 1


def test_an_odometer_has_measured_nothing_before_the_first_step() -> None:
    odometer = TrueOdometer(lambda: Pose(1.0, 2.0, 90.0), 5.0)
    nothing = {
        "forward_m": 0.0,
        "forward_speed_m_s": 0.0,
        "straightness": 0.0,
        "turned_deg": 0.0,
    }
    assert odometer.metrics() == nothing
    assert odometer.forward_mm(5.0, []) == 0.0 and odometer.metrics() == nothing


def test_a_robot_without_a_distance_sensor_measures_no_way() -> None:
    odometer = SonarOdometer(ROLLING)
    assert [odometer.forward_mm(0.0, values) for values in ([1.0, 2.0], [100.0, 200.0])] == [0, 0]


# ---------------------------------------------------------------- tasks


def test_entries_of_an_observation_stand_in_the_order_of_its_numbers() -> None:
    """Channels, sensors, sampled, measured, last commands, and the target's entries."""
    sensor = HostSensor("scale", (Entry("weight", 0.0, 5.0),), lambda: None, observes_age=True)  # type: ignore[arg-type, return-value]
    task = replace(
        PARK,
        id="All-v0",
        sensors=(sensor,),
        sampled_entries=(SampledEntry("wind", 0.0, 1.0),),
        measured_entries=(Entry("forward", -1.0, 1.0),),
    )
    names = ["weight", "scale_age", "wind", "forward", "last_drive_speed", "last_turn_rate"]
    of_target = [entry.name for entry in task.target.entries]  # type: ignore[union-attr]
    assert [entry.name for entry in task.entries] == [*names, *of_target]
    tracker = SimpleNamespace(entries=lambda: (7.0, 8.0))
    watch = SimpleNamespace(numbers=lambda: (9.0, 10.0))
    state = EpisodeState(
        drawn=[3.0],
        commands=[5.0, 6.0],
        measured_s=0.0,
        odometer=SimpleNamespace(),  # type: ignore[arg-type]
        zeros=[],
        tracker=tracker,  # type: ignore[arg-type]
        watch=watch,  # type: ignore[arg-type]
    )
    observed = state.observe([1.0, 2.0], [4.0])
    assert observed.tolist() == [float(number) for number in range(1, 11)]
    assert observed.dtype == np.float32


@pytest.mark.parametrize(
    ("low", "high", "limits"),
    [
        (-100.0, 100.0, (-100.0, 100.0)),
        (40.0, 100.0, (0.0, 100.0)),
        (-100.0, -40.0, (-100.0, 0.0)),
    ],
)
def test_last_commands_are_0_after_a_reset_even_where_0_is_no_command(
    low: float, high: float, limits: tuple[float, float]
) -> None:
    interface = replace(PARK.interface, commands=(DriveSpeed(low, high), DriveTurnRate(-60, 60)))
    speed, turn = replace(PARK, interface=interface).command_entries
    assert (speed.name, speed.unit) == ("last_drive_speed", "mm/s")
    assert (speed.low, speed.high, speed.limits) == (low, high, limits)
    assert turn.limits == (-60, 60)
    assert SPINNING.command_entries == ()


def test_goal_that_is_drawn_is_that_of_the_observation_or_of_the_target() -> None:
    arm = get_task("RoboArm-v0")
    values = [float(number) for number in range(len(arm.entries))]
    assert arm.goal(values) == Goal({"rotation": 4.0, "low": 5.0, "high": 6.0, "grab": 7.0})
    assert arm.goal(values[:6]) == Goal({"rotation": 4.0, "low": 5.0})
    assert arm.goal([]) is None and RUN_AWAY.goal(values) is None
    assert PARK.target is not None
    place = PARK.target.place
    assert PARK.goal([]) == Goal({}, (place.x_mm, place.y_mm), place.heading_deg)


def test_task_with_a_goal_in_an_image_is_judged_by_two_distances() -> None:
    view = CameraView(width_px=30, height_px=40, image_px=20)
    seen = replace(SPINNING, camera=view)
    assert seen.task_entries == seen.entries == SPINNING.entries
    with_goal = replace(seen, camera=replace(view, goal=VisualGoal(((3, 4),))))
    *others, mean, nearest = with_goal.task_entries
    assert tuple(others) == with_goal.entries
    assert mean == Entry("mean_distance", 0.0, 50.0, "px")
    assert nearest == Entry("nearest_distance", 0.0, 50.0, "px")
    assert with_goal.images == {"image": 20} and SPINNING.images == {}
    assert [task.has_hidden_entries for task in (SPINNING, seen, PARK)] == [False, True, True]


def test_first_paragraph_of_a_description_is_its_summary() -> None:
    task = replace(SPINNING, doc="\n  Spins,\n  fast.\n\n  And so on.\n")
    assert task.summary == "Spins, fast."
    assert SPINNING.rate_hz == 10.0 and RUN_AWAY.rate_hz == 1.0
    every_40_ms = replace(SPINNING.interface, settle=Wait(40))
    assert replace(SPINNING, interface=every_40_ms).rate_hz == 25.0


def test_outcome_of_an_episode_is_one_number_each() -> None:
    whole = torch.zeros(4, 6)
    good = replace(
        SPINNING,
        success=lambda observations: torch.tensor([True]),
        metrics=lambda observations: {"way_mm": torch.tensor([2.5]), "count": 3},
    )
    assert success_of(good, whole) is True
    assert metrics_of(good, whole) == {"way_mm": 2.5, "count": 3.0}
    for wrong, given_ in (
        (lambda observations: torch.zeros(2), "of shape [2]"),
        (lambda observations: "yes", "'yes'"),
    ):
        with pytest.raises(DescriptionError) as caught:
            success_of(replace(SPINNING, success=wrong), whole)
        says = f"success of Spinning-v0 is {given_}; give one number for an episode"
        assert str(caught.value) == says
    bad = replace(SPINNING, metrics=lambda observations: {"way_mm": None})
    with pytest.raises(
        DescriptionError, match=r"^metrics\['way_mm'\] of Spinning-v0 is None; give"
    ):
        metrics_of(bad, whole)


def test_metric_has_no_name_of_what_is_measured_of_a_walking_robot() -> None:
    class Walking(SpecsEnv):
        def walk_metrics(self) -> dict[str, float]:
            return {"forward_m": 1.5}

    rollout = Rollout(rewards=[1.0], observations=[torch.zeros(6)])
    task = replace(SPINNING, metrics=lambda observations: {"forward_m": torch.zeros(1)})
    with pytest.raises(DescriptionError) as caught:
        rollout.judged(Walking({}, task))
    assert str(caught.value) == (
        "metrics of Spinning-v0 have the name 'forward_m', which is measured of each virtual robot "
        "that moves; give it another one"
    )
    success, metrics = rollout.judged(Walking({}, SPINNING))
    assert success is False and metrics == {"mean_yaw_rate_deg_s": 0.0, "forward_m": 1.5}
    assert rollout.judged(SpecsEnv({}, None)) == (None, {})


def test_draws_of_goals_places_and_twins_are_streams_of_their_own() -> None:
    one, same, other = (chance_of(seed) for seed in (3, 3, 4))
    one.place.random(100)
    assert one.host.random() == same.host.random() != other.host.random()
    assert one.twin_seed == same.twin_seed != other.twin_seed
    assert same.place.random() != same.host.random()
    assert chance_of(None).twin_seed != chance_of(None).twin_seed


# ---------------------------------------------------------------- the hub alone


def test_a_hub_makes_trials_of_so_many_steps_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    from bricksrl.envs import hub_policy

    monkeypatch.setattr(hub_policy, "LONGEST_TRIAL_MS", 10_000)
    monkeypatch.setattr(hub_policy, "MOST_STEPS", 150)
    steps = [most_steps(replace(ROLLING, settle=Wait(step_ms))) for step_ms in (50, 100, 300)]
    assert steps == [150, 100, 33]


def test_who_acts_step_by_step_knows_why() -> None:
    plain = EnvOptions()
    client = SimpleNamespace()
    model = SimpleNamespace(runs_programs=True)
    known: dict[str, Any] = {
        "robot": SimpleNamespace(hub=SimpleNamespace(model=model)),
        "client": None,
        "camera": None,
        "sensors": (),
        "base_env": None,
        "interface": SimpleNamespace(channels=(1, 2)),
        "observed_channels": (0, 1),
    }
    bare = SimpleNamespace(hub=SimpleNamespace(model=SimpleNamespace(runs_programs=False)))
    at_computer = "a camera or a sensor is on this computer"
    between = "transforms are between the robot and its agent"
    for changes, options, reason in (
        ({}, plain, ""),
        ({"robot": bare}, plain, "its devices run no programs"),
        ({"client": client}, plain, "it runs a client of your own"),
        ({"camera": client}, plain, at_computer),
        ({"sensors": (client,)}, plain, at_computer),
        ({}, EnvOptions(streaming=True), "it streams"),
        ({}, EnvOptions(frame_skip=2), between),
        ({"base_env": client}, plain, between),
        ({"observed_channels": (0,)}, plain, "it does not observe all that its hub measures"),
    ):
        task: Any = SimpleNamespace(**{**known, **changes})
        assert by_steps_because(task, options) == reason


# ---------------------------------------------------------------- the registry

NOISE = "normal noise with a standard deviation of {} is added to each action, in -1..1"
START = "An episode starts at angles that are drawn from their ranges, and so are goals."
ZEROS = "pitch, roll, distance are always 0."


@pytest.mark.parametrize(
    ("env_id", "motion", "noise", "rest"),
    [
        ("RoboArmSim-v0", "at once", "0.05", START),
        ("WalkerSim-v0", "at once", "0.1", f"{ZEROS} {START}"),
        (
            "WalkerSim-v1",
            "as far as the firmware turns it in the time of a step",
            "0.02",
            f"{ZEROS} {START}",
        ),
    ],
)
def test_page_of_a_simulation_says_how_it_differs(
    env_id: str, motion: str, noise: str, rest: str
) -> None:
    assert simulation_text(env_id) == (
        f"There is no hub: each motor turns by its command, {motion}; {NOISE.format(noise)}. {rest}"
    )


def test_copies_make_ten_million_steps_together_by_default() -> None:
    found = {env_id: training_episodes(env_id) for env_id in list_envs()}
    assert {name: found[name] for name in registry.BUILT_IN} == {
        "LineFollow-v0": 30,
        "Park-v0": 30,
        "RunAway-v0": 40,
        "Spinning-v0": 15,
        "Walker-v0": 75,
        "Walker-v1": 75,
        "Walker-v2": 12,
        "WalkerSim-v0": 75,
        "WalkerSim-v1": 75,
        "RoboArm-v0": 250,
        "RoboArm_mixed-v0": 250,
        "RoboArmSim-v0": 250,
    }
    # Episodes of WalkerSim-v0 have 100 steps.
    episodes = [training_episodes("WalkerSim-v0", copies) for copies in (1, 2, 1333, 1334, 4096)]
    assert episodes == [75, 75, 75, 74, 24]
    assert training_episodes("WalkerSim-v0", 99_999_999) == 1


def test_simulations_are_told_apart_in_the_list() -> None:
    listed = list_envs()
    note = " (simulated without a hub, thousands at once)"
    assert listed["WalkerSim-v0"] == get_task("WalkerSim-v0").summary + note
    assert listed["WalkerSim-v1"].endswith(
        " (simulated without a hub, thousands at once; legs turn as the firmware turns them)"
    )
    assert listed["RunAway-v0"] == get_task("RunAway-v0").summary


def test_option_that_is_none_is_refused_with_all_that_there_are() -> None:
    with pytest.raises(UnknownOptionError) as caught:
        get_task("RunAway-v0", ends_at_wal=True)
    of_all = [field.name for field in dataclasses.fields(EnvOptions) if field.name != "options"]
    own = ["seed", "copies", "place", "arrays", "watched_button"]
    assert str(caught.value) == (
        "RunAway-v0 has no option ends_at_wal (did you mean 'ends_at_wall'?); its task has "
        f"ends_at_wall, robot, all environments like it have {', '.join([*own, *of_all])} "
        "(unexpected keyword argument 'ends_at_wal')"
    )
    with pytest.raises(UnknownOptionError) as caught:
        get_task("Walker-v2", colour="red")
    assert "has no option colour; its task has none, all environments" in str(caught.value)
    with pytest.raises(UnknownOptionError) as caught:
        get_task("WalkerSim-v0", colour="red")
    of_simulations = "seed, copies, batch_size, device, kinematics, place, frame_stack, frame_skip"
    assert f"like it have {of_simulations}, transform (unexpected" in str(caught.value)
    assert registry.options_of("RunAway-v0", {"ends_at_wall": False, "colour": 1}) == {
        "ends_at_wall": False
    }


# ---------------------------------------------------------------- simulations


def test_devices_are_found_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    from bricksrl.envs import simulation

    assert resolve_device("cpu") == resolve_device(torch.device("cpu")) == torch.device("cpu")
    monkeypatch.setattr(simulation, "_accelerators", list)
    assert resolve_device("auto") == torch.device("cpu")
    monkeypatch.setattr(simulation, "_accelerators", lambda: ["meta", "mps"])
    assert resolve_device("auto") == torch.device("meta"), "the best one comes first"
    with pytest.raises(RunError) as caught:
        resolve_device("tpu")
    says = "there is no device 'tpu' here; choose cpu, meta, mps or auto"
    assert str(caught.value) == says


def test_sampled_entries_of_a_simulation_are_whole_where_the_task_says_so() -> None:
    env = SimulatedEnv(SPINNING, Kinematics(noise=0.0), batch_size=400, seed=0)
    first = env.reset()["observation"]
    direction = first[:, 5]
    assert sorted(set(direction.tolist())) == [0.0, 1.0]
    assert 0.4 < direction.mean() < 0.6
    assert (first[:, 2:5] == 0.0).all(), "what no motor turns reads 0"


def test_commands_of_a_simulation_are_in_the_middle_and_half_of_their_ranges() -> None:
    task = get_task("WalkerSim-v0")
    (first, *others) = task.interface.commands
    interface = replace(task.interface, commands=(replace(first, low=10.0, high=50.0), *others))
    action = torch.full((4000, 4), 0.5)
    env = SimulatedEnv(replace(task, interface=interface), Kinematics(0.1), batch_size=4000, seed=1)
    state = env.reset()
    legs = state["observation"][:, :2].clone()
    after = env.step(state.set("action", action))["next", "observation"][:, :2]
    turned = (after - legs + 180.0) % 360.0 - 180.0
    assert turned.mean(0).tolist() == pytest.approx([40.0, -25.0], abs=0.5)
    assert turned.std(0).tolist() == pytest.approx([2.0, 5.0], rel=0.06)


def test_motion_of_the_firmware_needs_a_fixed_time() -> None:
    task = get_task("WalkerSim-v0")
    without = replace(task, interface=replace(task.interface, settle=UntilDone()))
    with pytest.raises(DescriptionError) as caught:
        SimulatedEnv(without, Kinematics(0.0, motion="firmware"))
    assert str(caught.value) == (
        "WalkerSim-v0 cannot be simulated with the firmware's motion; it needs a Wait, and motors "
        "without ends"
    )
    SimulatedEnv(without, Kinematics(0.0))


def test_real_robot_is_placed_by_whom_the_caller_names_or_by_whoever_reads_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    placed: list[Any] = []
    env: Any = bricksrl.make("RunAway-v0", hub="ble", place=placed.append)
    rng = np.random.default_rng(0)
    env._connected().place(rng)
    assert placed == [rng] and not caplog.messages
    env = bricksrl.make("RunAway-v0", hub="ble")
    env._connected().place(rng)
    assert caplog.messages == ["RunAway-v0: put the robot where an episode starts"]
