"""Hand-written controllers: what each does in a state, by hand-computed numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from brickhub.robot.line_edge import LineEdge, edge_of
from bricksrl.envs.registry import get_task
from bricksrl.envs.tasks import scripted
from bricksrl.envs.tasks.walker import gait_reward, reward

TROT = np.array([0.0, 180.0, 180.0, 0.0])
ANGLES = st.floats(0.0, 359.0)


def seen(*numbers: float) -> dict[str, np.ndarray]:
    return {"observation": np.array(numbers, np.float32)}


def test_who_runs_away_or_spins_does_so_at_full_speed() -> None:
    assert scripted.run_away(seen(0.0)).tolist() == [-1.0]
    assert scripted.spin(seen(7.0, 0.0)).tolist() == [-1.0, 1.0]
    assert scripted.spin(seen(7.0, 1.0)).tolist() == [1.0, -1.0]


@settings(max_examples=25)
@given(start=ANGLES)
def test_legs_in_a_trot_stay_in_it(start: float) -> None:
    legs = (TROT + start) % 360.0
    assert scripted.trot(seen(*legs)).tolist() == pytest.approx([-0.8] * 4, abs=1e-4)
    # Phases of this controller are 4 degrees apart.
    turns = scripted.into_step(seen(*legs))
    assert turns.max() - turns.min() < 1e-4


def test_a_leg_that_is_behind_in_a_trot_turns_faster() -> None:
    """Legs turn backwards: one at a larger angle has farther to go."""
    action = scripted.trot(seen(*np.add(TROT, (10.0, 0.0, 0.0, 0.0))))
    # The mean of the four directions is 2.4953 degrees ahead.
    ahead, others = -0.8 - 1.2 * math.radians(7.5047), -0.8 + 1.2 * math.radians(2.4953)
    assert action.tolist() == pytest.approx([ahead, others, others, others], abs=1e-4)
    far = scripted.trot(seen(*np.add(TROT, (90.0, 0.0, 0.0, 0.0))))
    assert far.min() == -1.0 and far.max() < 0.0


@settings(max_examples=25)
@given(legs=st.lists(ANGLES, min_size=4, max_size=4))
def test_legs_anywhere_come_into_step(legs: list[float]) -> None:
    angles = np.array(legs)
    for _ in range(6):
        action = scripted.into_step(seen(*angles))
        assert ((action >= -1.0) & (action <= 1.0)).all()
        angles = (angles - 50.0 * (1.0 - action)) % 360.0
    off = gait_reward(torch.tensor([[*angles, 0.0, 0.0, 500.0]])).item()
    assert off > -0.1, "a few degrees are not worth the turn"


def test_the_next_trot_is_the_one_that_the_task_rewards_most() -> None:
    """Less half a turn of a leg for each 1 that is left to turn after this step."""
    phases = torch.arange(0.0, 360.0, 4.0)[:, None] + torch.tensor(TROT)  # [90, 4]
    for start in torch.rand((12, 4), generator=torch.Generator().manual_seed(3)) * 360.0:
        turns = (start - phases).remainder(360.0)
        turned = turns.clamp_max(100.0)
        after = torch.zeros(90, 7)
        after[:, :4] = (start - turned).remainder(360.0)
        paid = reward(after, 1.0 - turned / 50.0, after)[:, 0]
        best = (paid - (turns - turned).sum(-1) / 180.0).argmax()
        action = scripted.into_step(seen(*start.tolist()))
        assert action.tolist() == pytest.approx((1.0 - turned[best] / 50.0).tolist(), abs=1e-3)


def test_joints_turn_by_their_errors_the_rotation_the_shorter_way() -> None:
    start = (350.0, 10.0, -20.0, 5.0)
    action = scripted.reach(seen(*start, 10.0, 25.0, -50.0, 17.5))
    assert action.tolist() == pytest.approx([0.2, 0.5, -0.5, 0.5])
    action = scripted.reach(seen(10.0, *start[1:], 350.0, 100.0, -200.0, 5.0))
    assert action.tolist() == pytest.approx([-0.2, 1.0, -1.0, 0.0])


def disc(row: int, column: int, color: tuple[int, int, int] = (0, 200, 0)) -> np.ndarray:
    """An image with a spot of 2 x 2 px between this place and the next."""
    image = np.full((64, 64, 3), 180, np.uint8)
    image[row : row + 2, column : column + 2] = color
    return image


@pytest.mark.parametrize(
    ("row", "column", "joints", "action"),
    [
        # 22 px below the middle are 165 of the frame: 2 px more than at -70 degrees.
        (53, 31, (0.0, 0.0, -70.0), (0.0, 0.0, 2.5 / 60)),
        (53, 31, (-45.0, 0.0, -70.0), (0.5, 0.0, 2.5 / 60)),
        (53, 31, (350.0, 0.0, -67.5), (10 / 90, 0.0, 0.0)),
        # 16 px to the right are 160 of the frame.
        (31, 47, (45.0, 0.0, -70.0), (0.5, 0.0, -3.75 / 60)),
        (31, 15, (-45.0, 0.0, -70.0), (-0.5, 0.0, -3.75 / 60)),
        (31, 47, (-45.0, 0.0, 20.0), (1.0, 0.0, -1.0)),
    ],
)
def test_an_arm_turns_and_stretches_to_the_green_disc(
    row: int, column: int, joints: tuple[float, ...], action: tuple[float, ...]
) -> None:
    found = scripted.bring({**seen(*joints), "image": disc(row, column)})
    assert found.tolist() == pytest.approx(action, abs=1e-6)


@pytest.mark.parametrize("color", [(180, 180, 180), (200, 200, 0), (0, 200, 200), (0, 90, 0)])
def test_what_is_no_green_disc_moves_no_arm(color: tuple[int, int, int]) -> None:
    found = scripted.bring({**seen(30.0, 0.0, -50.0), "image": disc(53, 31, color)})
    assert found.tolist() == [0.0, 0.0, 0.0]


def test_a_line_is_followed_by_how_much_brighter_it_is_than_its_edge() -> None:
    edge = LineEdge(10.0, 70.0)
    turns = [scripted.follow(seen(pct), edge)[1] for pct in (40.0, 0.0, 80.0, 60.0, 100.0)]
    assert turns == pytest.approx([0.0, -0.8, 0.8, 0.4, 1.0])
    assert scripted.follow(seen(0.0), edge)[0] == 0.0, "half speed"
    task = get_task("LineFollow-v0")
    on_edge = seen(edge_of(task.robot).edge_pct)
    assert scripted.controller_of("LineFollow-v0", task)(on_edge)[1] == pytest.approx(0.0, abs=1e-6)
    assert scripted.controller_of("Park-v0", get_task("Park-v0")) is scripted.park


@pytest.mark.parametrize(
    ("ahead_mm", "left_mm", "turn_deg", "action"),
    [
        (50.0, 0.0, 0.0, (0.5, 0.0)),
        (200.0, 0.0, 0.0, (1.0, 0.0)),
        (-50.0, 0.0, 0.0, (-0.5, 0.0)),
        # In the bay only the heading is left.
        (5.0, -6.0, 12.0, (0.0, 0.4)),
        (0.0, 0.0, -45.0, (0.0, -1.0)),
        # An arc of 30 degrees to the left ends with its heading: in 1 s 80 mm of a radius.
        (
            80 * math.cos(math.radians(15)),
            80 * math.sin(math.radians(15)),
            -30.0,
            (0.8, math.degrees(-2 * math.sin(math.radians(15))) / 60),
        ),
        # Straight ahead with another heading, it turns away from it first, and drives slower.
        (
            80.0,
            0.0,
            30.0,
            (
                0.8 * math.cos(math.radians(30)),
                (-75 + math.degrees(2 * math.cos(math.radians(30)) * math.sin(math.radians(15))))
                / 60,
            ),
        ),
        # At the side, the arc points backwards: it turns on the spot.
        (0.0, 80.0, 90.0, (0.0, 1.0)),
    ],
)
def test_a_robot_parks_by_an_arc(
    ahead_mm: float, left_mm: float, turn_deg: float, action: tuple[float, float]
) -> None:
    found = scripted.park(seen(9.0, ahead_mm, left_mm, turn_deg, 9.0, 9.0))
    assert found.tolist() == pytest.approx(action, abs=1e-5)
