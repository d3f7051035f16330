"""The environment checker on valid and wrong environments."""

from __future__ import annotations

import logging
import random
import re
from dataclasses import replace

import pytest
import torch

import bricksrl
from brickhub.entry import Entry
from brickhub.finding import Outcome
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.robot import HubKind, Motor, Robot
from bricksrl.envs.env_checker import check_env
from bricksrl.envs.host_sensors.host_sensor import HostSensor
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING

MINE = replace(SPINNING, id="Mine-v0", doc="Spins.", max_steps=4)


def outcome_of(task: Task, name: str) -> tuple[Outcome, str]:
    """What one check finds; those after it are not made."""
    bricksrl.register(task)
    check = next(check for check in check_env(task.id) if check.name == name)
    return check.outcome, check.detail


def outcomes(task: Task) -> dict[str, tuple[Outcome, str]]:
    bricksrl.register(task)
    return {check.name: (check.outcome, check.detail) for check in check_env(task.id)}


@pytest.mark.parametrize("env_id", bricksrl.list_envs())
def test_our_environments_pass_check(env_id: str) -> None:
    checks = list(check_env(env_id))
    skipped = {"twin"} if "Sim" in env_id else set()
    assert {check.name for check in checks if check.outcome is Outcome.SKIPPED} == skipped
    assert [check for check in checks if check.outcome is Outcome.ERROR] == []
    assert len(checks) == 8
    assert all("\n" not in check.detail for check in checks)


def test_description_without_tables_passes() -> None:
    found = outcomes(MINE)
    assert found.pop("description")[0] is Outcome.SKIPPED
    assert {outcome for outcome, _ in found.values()} == {Outcome.OK}


def raises(*_: torch.Tensor) -> torch.Tensor:
    raise IndexError("index 9 is out of\nbounds")


def unlike(previous: torch.Tensor, action: torch.Tensor, observation: torch.Tensor) -> torch.Tensor:
    return SPINNING.reward(previous, action, observation) + random.random()


WRONG_TABLES = [
    SPINNING.doc.replace("| 0   | left_angle  | 0    |", "| 0   | left_angle  | 1    |"),
    SPINNING.doc.replace("| -100       | 100      |", "| -90        | 100      |", 1),
    SPINNING.doc.replace("after 50 steps", "after 40 steps"),
    " \n",
]

CLOCK = HostSensor("clock", (Entry("second", 0.0, 60.0, "s"),), open=dict)


@pytest.mark.parametrize(
    ("change", "name", "says"),
    [
        *(({"doc": doc, "max_steps": 50}, "description", "") for doc in WRONG_TABLES),
        (
            {"doc": SPINNING.doc, "max_steps": 50, "sensors": (CLOCK,)},
            "description",
            "'direction', 0.0, 1.0, ''); correct it, and give a changed copy of a task a doc",
        ),
        (
            {"doc": re.sub(r"\| 5 .*\n", "", SPINNING.doc), "max_steps": 50},
            "description",
            "at 5 rows in place of 6; correct it",
        ),
        ({"reward": raises}, "functions", "IndexError: index 9"),
        ({"reward": raises}, "specs", "the same as in functions"),
        ({"reward": lambda p, a, o: o[..., 4:5] * float("nan")}, "determinism", "the same as in"),
        ({"reward": unlike}, "determinism", "another episode"),
        ({"reward": lambda p, a, o: o[..., 4]}, "functions", "reward has the shape"),
        ({"reward": lambda p, a, o: o[..., 4:5] / 0.0}, "functions", "not always a number"),
        ({"success": lambda o: o[..., -1, 4:5] > 0}, "functions", "success has the shape"),
        (
            {"success": lambda o: True},
            "functions",
            "success is no tensor but bool; compute it from the observations",
        ),
        ({"success": lambda o: o[..., -1, 4]}, "functions", "success is not bool"),
        ({"metrics": lambda o: {"end": o[..., -1, :]}}, "functions", "end has the shape"),
        ({"robot": Robot("two-wheeler", HubKind.MOVE)}, "hub program", "not supported"),
    ],
)
def test_wrong_environments_fail_check(change: dict[str, object], name: str, says: str) -> None:
    outcome, detail = outcome_of(replace(MINE, **change), name)
    assert outcome is Outcome.ERROR
    assert says in detail
    assert "\n" not in detail


def test_only_findings_are_printed(capfd: pytest.CaptureFixture[str]) -> None:
    """TorchRL's own log writes on standard output."""
    logger = logging.getLogger("torchrl")
    before = logger.level
    logger.setLevel(logging.INFO)
    try:
        assert all(finding.outcome is not Outcome.ERROR for finding in check_env("RoboArmSim-v0"))
        assert logger.level == logging.INFO
    finally:
        logger.setLevel(before)
    assert capfd.readouterr() == ("", "")


def test_unresponsive_observation_fails_check() -> None:
    motors = (Motor("arm", "A"), Motor("idle", "B"))
    interface = Interface((RunAngle("arm", -10, 10, 100),), (MotorAngle("idle"),), Wait(50))
    never = replace(
        RUN_AWAY,
        id="Never-v0",
        doc="Idle.",
        robot=Robot("bench", HubKind.PRIME, motors),
        interface=interface,
    )
    nothing = replace(
        never,
        scene=bricksrl.envs.task.OPEN_FLOOR,
        reward=lambda p, a, o: o[..., :1],
        terminated=bricksrl.envs.task.never,
        success=lambda o: o[..., -1, 0] > 0,
        metrics=lambda o: {},
    )
    outcome, detail = outcome_of(nothing, "twin")
    assert outcome is Outcome.ERROR
    assert "nothing that it observes changed" in detail
