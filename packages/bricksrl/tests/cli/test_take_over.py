"""A human who takes over, and a fleet on a page."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bricksrl.cli import main
from bricksrl.cli.app import parse
from bricksrl.data import load
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
