"""A human who takes over, and a fleet on a page."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from bricksrl.cli import main
from bricksrl.cli.app import parse
from bricksrl.data import load
from bricksrl.errors import PageError
from bricksrl.training import RunFolder


@pytest.mark.parametrize(
    ("env", "hub", "realtime"), [("Walker-v0", "virtual", True), ("Walker-v0", "ble", False)]
)
def test_only_a_virtual_robot_is_driven_in_real_time(env, hub, realtime):
    command = parse(["train", env, "--hub", hub, "--take-over", "gamepad"])
    assert command.config(env).realtime is realtime, "a real robot has its own time"


class Pad:
    """A gamepad whose stick is held up."""

    def read(self):
        return [1.0], 1

    def close(self):
        pass


@pytest.mark.parametrize("command", ["train", "record"])
def test_human_takes_over_in_a_simulation(command, tmp_path, monkeypatch, capfd):
    naps = []
    monkeypatch.setattr("bricksrl.teleoperation.find_pad", Pad)
    monkeypatch.setattr(
        "bricksrl.teleoperation.time", SimpleNamespace(perf_counter=lambda: 0.0, sleep=naps.append)
    )
    monkeypatch.setattr("bricksrl.cli.train._report", lambda *_, **__: None)
    out = (
        ("--run", str(tmp_path / "run"))
        if command == "train"
        else ("--out", str(tmp_path / "run/data"))
    )
    assert main([command, "WalkerSim-v0", "--take-over", "gamepad", "--episodes", "1", *out]) == 0
    recorded = load(tmp_path / "run")
    assert recorded.intervention.tolist() == [True, False] * 50
    assert naps == [0.25 * (step + 1) for step in range(100)], "as fast as a robot"


@pytest.mark.realtime
def test_fleet_learns_on_a_page(forked_children, tmp_path, capfd):
    command = [
        "train",
        "RunAway-v0",
        "--agent",
        "random",
        "--robots",
        "2",
        "--episodes",
        "2",
        "--run",
        str(tmp_path / "run"),
    ]
    assert main([*command, "--page", "--no-film"]) == 0
    assert len(RunFolder(tmp_path / "run").read_episodes()) == 2


@pytest.mark.parametrize(
    ("options", "can_drive"),
    [
        ((), True),
        (("--robots", "2"), False),
        (("--num-envs", "2"), False),
        (("--take-over", "gamepad"), False),
    ],
)
def test_the_page_of_a_run_drives_its_only_robot(options, can_drive, monkeypatch, tmp_path, capfd):
    told = []

    @contextmanager
    def run_on_page(*_, can_drive, **__):
        told.append(can_drive)
        raise PageError("no page here; this is all that is asked")
        yield

    monkeypatch.setattr("bricksrl.teleoperation.find_pad", Pad)
    monkeypatch.setattr("bricksrl.cli.train.run_on_page", run_on_page)
    env = "WalkerSim-v0" if "--num-envs" in options else "RunAway-v0"
    command = ["train", env, "--page", "--run", str(tmp_path / "run"), *options]
    assert main(command) == 2
    assert "this is all that is asked" in capfd.readouterr().err
    assert told == [can_drive]


@pytest.mark.parametrize(("policy", "driven_by"), [("random", "page"), ("gamepad", "pad")])
def test_who_drives_while_a_page_is_open(policy, driven_by, monkeypatch, tmp_path):
    driver = SimpleNamespace(name="page")
    page = SimpleNamespace(driver=driver, attach=lambda env: None, show_step_and_hold=None)
    drivers = []

    @contextmanager
    def run_on_page(*_, **__):
        yield page

    def collect(*_, driver, **__):
        drivers.append(driver)

    monkeypatch.setattr("bricksrl.teleoperation.find_pad", Pad)
    monkeypatch.setattr("bricksrl.cli.record.run_on_page", run_on_page)
    monkeypatch.setattr("bricksrl.data.collect.collect", collect)
    command = ["record", "WalkerSim-v0", "--policy", policy, "--page"]
    assert main([*command, "--out", str(tmp_path / "data")]) == 0
    (found,) = drivers
    assert (found is driver) == (driven_by == "page")
    assert found is not None
