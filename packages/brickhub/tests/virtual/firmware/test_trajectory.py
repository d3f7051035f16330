"""Properties of the reference trajectories."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.virtual.firmware import InfeasibleMoveError
from brickhub.virtual.firmware.trajectory import (
    FOREVER_MS,
    Trajectory,
    TrajectoryCommand,
    for_time,
    to_angle,
)

SPEEDS = st.integers(-1_000_000, 1_000_000)
commands = st.builds(
    TrajectoryCommand,
    time=st.integers(0, 10**7),
    position=st.integers(-(10**7), 10**7),
    speed=SPEEDS,
    target_speed=SPEEDS.filter(lambda speed: abs(speed) >= 10_000),
    max_speed=st.just(1_000_000),
    acceleration=st.integers(500_000, 4_000_000),
    deceleration=st.integers(500_000, 4_000_000),
    keep_running=st.booleans(),
)
distances = st.integers(-(10**6), 10**6)


@given(commands, distances)
def test_angle_command_ends_at_target(command: TrajectoryCommand, distance: int) -> None:
    command = command._replace(end=command.position + distance)
    trajectory = to_angle(command)
    assert trajectory.end.position == command.end
    assert 0 <= trajectory.t1 <= trajectory.t2 <= trajectory.t3
    if not command.keep_running:
        assert trajectory.end.speed == 0


@given(commands, distances)
def test_reference_is_continuous_within_speed_limit(
    command: TrajectoryCommand, distance: int
) -> None:
    trajectory = to_angle(command._replace(end=command.position + distance))
    fastest = max(abs(trajectory.w0), abs(trajectory.w1)) * 100
    before = trajectory.reference(command.time)
    for time in range(command.time + 10, command.time + trajectory.t3 + 500, 50):
        now = trajectory.reference(time)
        # 5 ms at the top speed, and what rounding at the ends of the phases may add
        assert abs(now.position - before.position) <= fastest * 0.005 + 400
        assert abs(now.speed) <= fastest + 1000
        before = now


@given(commands, st.integers(1, FOREVER_MS * 10))
def test_timed_command_lasts_duration(command: TrajectoryCommand, duration: int) -> None:
    try:
        trajectory = for_time(command._replace(duration=duration))
    except InfeasibleMoveError:
        assert command.acceleration != command.deceleration, (
            "only rates that differ can leave no trajectory"
        )
        return
    assert trajectory.t3 == duration
    assert 0 <= trajectory.t1 <= trajectory.t2 <= trajectory.t3


def test_timed_command_without_trajectory_raises() -> None:
    """Deceleration at 1000, then 999 deg/s²: the ramps meet beyond the end."""
    command = TrajectoryCommand(
        0, 0, 953_188, 946_637, 1_000_000, 1_000_000, 999_000, keep_running=False, duration=5331
    )
    with pytest.raises(InfeasibleMoveError):
        for_time(command)
    assert for_time(command._replace(deceleration=1_000_000)).t3 == 5331


def test_long_stretched_trajectory_loses_digits() -> None:
    command = TrajectoryCommand(
        0, 0, 0, 1_000_000, 1_000_000, 2_000_000, 2_000_000, keep_running=False, end=21_475_000
    )
    leader, follower = to_angle(command), to_angle(command)
    follower.stretch(leader)
    assert follower.w1 % 100 == 0 and leader.w1 == 10_000


@given(commands, distances, distances)
def test_stretched_trajectory_ends_with_leader(
    command: TrajectoryCommand, short: int, long: int
) -> None:
    command = command._replace(speed=0, keep_running=False)
    one = to_angle(command._replace(end=command.position + short))
    other = to_angle(command._replace(end=command.position + long))
    leader, follower = (one, other) if one.t3 > other.t3 else (other, one)
    end = follower.end.position
    follower.stretch(leader)
    assert (follower.t1, follower.t2, follower.t3) == (leader.t1, leader.t2, leader.t3)
    assert follower.end.position == end


def test_zero_length_move_ends_immediately() -> None:
    command = TrajectoryCommand(
        5, 7, 0, 100_000, 1_000_000, 2_000_000, 2_000_000, keep_running=False, end=7
    )
    assert to_angle(command).end == Trajectory(5, 7).end


def test_too_long_move_raises() -> None:
    command = TrajectoryCommand(
        0, 0, 0, 100_000, 1_000_000, 2_000_000, 2_000_000, keep_running=False, end=2**31
    )
    with pytest.raises(ValueError, match="too large"):
        to_angle(command)
    with pytest.raises(ValueError, match="too long"):
        to_angle(command._replace(end=10**9, target_speed=10_000))
    with pytest.raises(ValueError, match="too long"):
        for_time(command._replace(duration=10**8))
