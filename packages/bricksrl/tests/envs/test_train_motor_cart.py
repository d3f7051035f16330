"""A cart with a train motor holds its distance from a wall; a remote's button ends the episode, and
a lamp shows its state."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest
import torch
from torch import Tensor

import bricksrl
from brickhub.hub.program.generate import validate
from bricksrl.envs import Task, register
from bricksrl.evaluation import evaluate
from bricksrl.hub.interface import Distance, Interface, LightBrightness, RemoteButton, RunDuty, Wait
from bricksrl.robots import (
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from bricksrl.training import TrainConfig, train
from bricksrl.twin.scene import Scene

WHEEL_MM_PER_DEG = 17.5 * 3.1416 / 360  # the wheels of LEGO's trains
WANTED_MM = 600.0

CART = Robot(
    "cart",
    HubKind.CITY,
    motors=(Motor("wheel", "A", MotorKind.TRAIN),),
    sensors=(UltrasonicSensor("eye", "B"),),
)
LIT_CART = Robot(
    "lit-cart",
    HubKind.TECHNIC,
    CART.motors,
    (*CART.sensors, PoweredUpSensor("lamp", "C", SensorKind.LIGHT)),
)


def ahead_mm(angles: Mapping[str, float]) -> float:
    return 1000.0 - WHEEL_MM_PER_DEG * angles["wheel"]


def off(observation: Tensor) -> Tensor:
    return (observation[..., :1] - WANTED_MM).abs() / 100.0


def task(robot: Robot, *lights: LightBrightness) -> Task:
    return Task(
        id=f"Cart{len(lights)}-v0",
        doc="A cart holds its distance from a wall, by full power ahead and back.",
        robot=robot,
        interface=Interface(
            (RunDuty("wheel"), *lights), (Distance("eye"), RemoteButton("right_minus")), Wait(200)
        ),
        max_steps=30,
        reward=lambda previous, action, observation: -off(observation),
        terminated=lambda observation: observation[..., 1:2] > 0.5,
        success=lambda observations: off(observations)[..., -1, 0] < 1.0,
        metrics=lambda observations: {"off_mm": 100.0 * off(observations)[..., -1, 0]},
        scene=Scene(readings={"eye": ahead_mm}),
    )


def test_button_ends_the_episode_and_the_lamp_shows() -> None:
    register(task(LIT_CART, LightBrightness("lamp")))
    with closing(bricksrl.make("Cart1-v0", seed=0)) as env:
        state = env.reset()
        panel = env.twin.machine.panel
        step = env.step(state.set("action", torch.tensor([1.0, 0.5])))
        assert step["next", "observation"][0] < state["observation"][0] - 10, "it drives"
        assert panel.lamps == {"C": 75} and not bool(step["next", "done"])
        panel.hold("remote.right_minus")
        step = env.step(env.step_mdp(step).set("action", torch.tensor([0.0, -1.0])))
        assert bool(step["next", "terminated"]) and panel.lamps == {"C": 0}
        panel.release("remote.right_minus")
        assert not bool(env.step(env.reset().set("action", torch.zeros(2)))["next", "done"])


def test_template_offers_hubs_that_our_program_runs_on() -> None:
    text = (resources.files("bricksrl.cli.templates") / "robot.py").read_text(encoding="utf-8")
    offered = re.findall(r"[A-Z]+", text.partition("HubKind.")[2].partition("\n")[0])
    assert len(offered) == 4
    for name in offered:
        validate(replace(CART, hub=HubKind[name]), task(CART).interface)


@pytest.mark.slow
def test_cart_learns(tmp_path: Path) -> None:
    register(task(CART))
    train(TrainConfig("Cart0-v0", "sac", episodes=25, run_dir=tmp_path / "run"))
    learned = evaluate(tmp_path / "run", episodes=3)
    with closing(bricksrl.make("Cart0-v0", seed=1)) as env:
        resting = float(
            env.rollout(30, lambda tensordict: tensordict.set("action", torch.zeros(1)))[
                "next", "reward"
            ].sum()
        )
    assert learned.return_mean > resting / 2 and learned.success_rate == 1.0
