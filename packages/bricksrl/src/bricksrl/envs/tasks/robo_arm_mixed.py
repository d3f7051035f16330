"""The RoboArm moves a red ball to a place that only a camera's image shows.

A camera looks down at the arm, which holds the ball. The hub turns three joints by the commanded
angle, within the joint's range, and answers 250 ms later; then the camera takes a frame of 640 x
480 px. The gripper does not move.

## Action

| Num | Action        | Min | Max | Turns from | Turns to | Unit |
|-----|---------------|-----|-----|------------|----------|------|
| 0   | rotation      | -1  | 1   | -90        | 90       | deg  |
| 1   | low           | -1  | 1   | -30        | 30       | deg  |
| 2   | high          | -1  | 1   | -60        | 60       | deg  |

## Observation

| Num | Observation    | Min  | Max | Unit |
|-----|----------------|------|-----|------|
| 0   | rotation_angle | 0    | 360 | deg  |
| 1   | low_angle      | 10   | 70  | deg  |
| 2   | high_angle     | -150 | 10  | deg  |

The rotation is wrapped into 0..360. A joint may yield a little beyond its range.

## Image

| Key   | Shape       | Type  | Min | Max | Meaning                                                    |
|-------|-------------|-------|-----|-----|------------------------------------------------------------|
| image | 64 x 64 x 3 | uint8 | 0   | 255 | the frame, red, green, blue, with the goal as a green disc |

The goal is one of 26 places on the lower half of a circle of 200 px around the middle of the frame,
moved by up to 25 px to the sides and 20 px up or down. The disc has a radius of 25 px of the frame.

## Reward

Minus the mean distance in px of the red objects in the frame, larger than 10 px, from the goal,
divided by 100. Without red in the frame it is the reward of the previous step, 0 at the start. With
`sparse=True` it is 1 within 40 px of the goal, else 0.

## End of an episode

| End        | When                                                  |
|------------|-------------------------------------------------------|
| terminated | a red object is within 40 px of the goal              |
| truncated  | after 30 steps                                        |

## Success and metrics

An episode succeeds when it reaches the goal. The metric is the distance of the nearest red object
from the goal at the end, `final_distance_px`; 800 if none is seen. The option `camera` selects the
camera of a real robot: a number, or the address of a stream.
"""  # noqa: E501

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.user_files import NotCode
from bricksrl.envs.task import Task, Tensor
from bricksrl.envs.vision.camera import CameraView, VisualGoal
from bricktwin.robots import ROBO_ARM
from bricktwin.twin.scene import Scene

REACHED_PX = 40.0
"""Distance from the goal within which the ball has arrived."""

_TURNS_DEG = {"rotation": 90, "low": 30, "high": 60}
"""Largest turn of each joint in a step."""
_WIDTH_PX = 640
_HEIGHT_PX = 480
_CIRCLE_PX = 200
"""Radius of the circle around the frame's centre on which goals lie."""
_PLACES = 26
_STEP_RAD = 1 / 8
"""Angle between two places: the discs on the circle, of 25 px each, overlap by half."""


def _on_lower_half_circle(place: int) -> tuple[int, int]:
    angle = place * _STEP_RAD
    x_px = _WIDTH_PX / 2 + _CIRCLE_PX * math.cos(angle)
    y_px = _HEIGHT_PX / 2 + _CIRCLE_PX * math.sin(angle)
    return int(x_px), int(y_px)


GOAL = VisualGoal(
    tuple(_on_lower_half_circle(place) for place in range(_PLACES)),
    jitter_px=(25, 20),
    radius_px=25,
)


def _channel(name: str) -> MotorAngle:
    """The angle of a joint in its range; the endless one is 0..360 degrees."""
    low_deg, high_deg = ROBO_ARM.motor(name).range_deg or (0, 360)
    return MotorAngle(name, float(low_deg), float(high_deg))


_COMMANDS = tuple(RunAngle(name, -turn, turn, speed_deg_s=250) for name, turn in _TURNS_DEG.items())

INTERFACE = Interface(
    commands=_COMMANDS,
    channels=tuple(_channel(name) for name in _TURNS_DEG),
    settle=Wait(250),
)


def robo_arm_mixed(
    env_id: str,
    *,
    sparse: bool = False,
    camera: Annotated[int | str, NotCode()] = 0,
    calibration: Annotated[str | Path | None, NotCode()] = None,
) -> Task:
    """The task with its options.

    Args:
        sparse: reward 1 at the goal and 0 elsewhere.
        camera: camera of a real robot: its OpenCV number, or the address of a stream.
        calibration: color calibration written by `bricksrl camera calibrate`. By default a real
            robot uses the one saved for its camera.

    Raises:
        CameraError: the calibration cannot be read.
    """
    goal = GOAL
    if calibration is not None:
        from bricksrl.envs.vision.color_calibration import read_red

        goal = replace(GOAL, red=read_red(Path(calibration)))

    # The last two entries are only for the task's functions: the mean distance of the red objects,
    # and that of the nearest one.
    def terminated(observation: Tensor) -> Tensor:
        nearest_px = observation[..., -1:]
        return nearest_px <= REACHED_PX

    def reward(
        _previous: Tensor,
        _action: Tensor,
        observation: Tensor,
    ) -> Tensor:
        if sparse:
            return terminated(observation).to(observation.dtype)
        mean_px = observation[..., -2:-1]
        return -mean_px / 100.0

    def success(observations: Tensor) -> Tensor:
        last = observations[..., -1, :]
        return terminated(last)[..., 0]

    def metrics(observations: Tensor) -> dict[str, Tensor]:
        return {"final_distance_px": observations[..., -1, -1]}

    return Task(
        id=env_id,
        doc=__doc__,
        robot=ROBO_ARM,
        interface=INTERFACE,
        max_steps=30,
        reward=reward,
        success=success,
        metrics=metrics,
        terminated=terminated,
        scene=Scene(ball=True),
        camera=CameraView(
            "webcam",
            camera,
            _WIDTH_PX,
            _HEIGHT_PX,
            goal=goal,
        ),
    )
