"""Motors of `WalkerSim-v1` against the firmware (data/firmware_motion.json)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from tensordict import TensorDict

import bricksrl
from bricksrl.envs.registry import get_task
from bricksrl.envs.simulation import ACCELERATION_DEG_S2, SimulatedEnv, turned_angle
from bricksrl.envs.task import Kinematics
from bricksrl.errors import DescriptionError

FIRMWARE = json.loads(
    (Path(__file__).parents[3] / "brickhub/tests/virtual/data/firmware_motion.json").read_text(
        encoding="utf-8"
    )
)
LAG_DEG = 2.0
"""Lag of the motor, and rounding to degrees."""
SPEEDS, TURNS = st.floats(-600, 600), st.floats(-360, 360)


@pytest.mark.parametrize(
    "move", FIRMWARE["run_angle_repeated"], ids=lambda move: f"{move['speed']} deg/s"
)
def test_overlapping_commands(move: dict[str, Any]) -> None:
    position = speed = torch.zeros(1)
    for expected in move["angles_after_each_then_at_rest"][:-1]:
        turned, speed = turned_angle(
            torch.tensor([float(move["angle"])]),
            speed,
            torch.tensor([float(move["speed"])]),
            move["every_ms"] / 1000,
        )
        position = position + turned
        assert abs(position.item() - expected) <= LAG_DEG


def test_every_moment_of_one_command() -> None:
    for trace in FIRMWARE["trace_20ms"]:
        command, limit = (
            torch.tensor([float(trace["angle"])]),
            torch.tensor([float(trace["speed"])]),
        )
        for i, expected in enumerate(trace["angles"]):
            turned, _ = turned_angle(command, torch.zeros(1), limit, (i + 1) * 0.02)
            assert abs(turned.item() - expected) <= LAG_DEG, i


@given(TURNS, SPEEDS, st.floats(10, 1000))
def test_motion_arrives_and_rests(turn: float, speed: float, limit: float) -> None:
    # The firmware takes a start that is too fast to stop, or too fast at all, as it comes: leave
    # those out.
    turned, rest = turned_angle(
        torch.tensor([turn]), torch.tensor([speed]), torch.tensor([limit]), 60.0
    )
    assert turned.item() == pytest.approx(turn, abs=0.05)
    assert rest.item() == pytest.approx(0.0, abs=0.5)


@given(TURNS, SPEEDS, st.floats(0.001, 0.5))
def test_no_jump_in_between(turn: float, speed: float, time_s: float) -> None:
    """Speed and acceleration limits hold in every millisecond."""
    limit = torch.tensor([600.0])
    at = [
        turned_angle(torch.tensor([turn]), torch.tensor([speed]), limit, t)
        for t in (time_s, time_s + 0.001)
    ]
    (one, one_speed), (other, other_speed) = ((a.item(), b.item()) for a, b in at)
    assert abs(other_speed - one_speed) <= ACCELERATION_DEG_S2 * 0.001 + 0.5
    assert abs(other - one) <= (max(abs(one_speed), abs(other_speed)) + 3.0) * 0.001 + 0.01


def test_walker_sim_v1_starts_slowly() -> None:
    """60 degrees in the first step and about 88 in later ones, as in the firmware; a reset clears
    the speed."""
    env = SimulatedEnv(
        get_task("WalkerSim-v1"), Kinematics(0.0, motion="firmware"), batch_size=2, seed=0
    )
    for _ in range(2):
        angle, turned = env.reset()["observation"][:, :4], []
        for _ in range(6):
            step = env.step(TensorDict({"action": -torch.ones(2, 4)}, [2]))["next"]
            turned.append((angle - step["observation"][:, :4]) % 360)
            angle = step["observation"][:, :4]
        assert ((turned[0] - 61).abs() < 1).all()
        assert ((torch.stack(turned[2:]).mean(0) - 88).abs() < 2).all()


def test_motion_is_an_option_of_the_kinematics() -> None:
    instant = bricksrl.make("WalkerSim-v1", kinematics=Kinematics(0.0), seed=0)
    before = instant.reset()["observation"][:4]
    after = instant.step(TensorDict({"action": -torch.ones(4)}, []))["next", "observation"][:4]
    assert torch.allclose((before - after) % 360, torch.full((4,), 100.0), atol=1e-3)
    with pytest.raises(DescriptionError, match="motion is 'ballistic'; choose instant or firmware"):
        Kinematics(0.0, motion="ballistic")  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match="motors without ends"):
        bricksrl.make("RoboArmSim-v0", kinematics=Kinematics(0.0, motion="firmware"))
