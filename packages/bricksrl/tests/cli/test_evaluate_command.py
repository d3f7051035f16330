"""``bricksrl evaluate``."""

from __future__ import annotations

import io
import json
import re
import shutil
from pathlib import Path

import pytest

from brickhub.errors import HubNotFoundError
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.cli import main
from bricksrl.envs import get_task
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.training import TrainConfig, train
from bricktwin.twin.make_body import make_body

EXAMPLES = Path(__file__).parents[4] / "examples"


def test_stdout_has_json_only(bricksrl, trained):
    done = bricksrl("evaluate", str(trained[0]), "--episodes", "2", "--seed", "7", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    assert result["env"] == "RunAway-v0"
    assert len(result["returns"]) == result["episodes"] == 2
    assert result["return_mean"] == pytest.approx(sum(result["returns"]) / 2)
    assert 0 <= result["success_rate"] <= 1
    assert result["return_std"] >= 0
    assert 0 < result["action_size"] <= 1
    assert 40 <= result["metrics"]["final_distance_mm"] <= 2000


def test_the_same_seed_gives_the_same_returns(trained, capsys):
    written = []
    for _ in range(2):
        assert main(["evaluate", str(trained[0]), "--episodes", "1", "--json"]) == 0
        written.append(capsys.readouterr().out)
    assert json.loads(written[0]) == json.loads(written[1])


def test_text_names_each_episode_and_the_mean(trained, capsys):
    assert main(["evaluate", str(trained[0]), "--episodes", "2"]) == 0
    written = capsys.readouterr().out
    assert re.findall(r"^episode (\d)/2  return ", written, re.MULTILINE) == ["1", "2"]
    assert re.search(r"^return   -?\d\S* ± \S+", written, re.MULTILINE)
    assert re.search(r"^final distance  \d+ mm$", written, re.MULTILINE)


def damage(run_dir):
    data = bytearray((run_dir / "checkpoint.bin").read_bytes())
    data[len(data) // 2] ^= 1
    (run_dir / "checkpoint.bin").write_bytes(data)


def truncate(run_dir):
    (run_dir / "checkpoint.bin").write_bytes((run_dir / "checkpoint.bin").read_bytes()[:1000])


def remove(run_dir):
    (run_dir / "checkpoint.bin").unlink()


def break_config(run_dir):
    (run_dir / "config.json").write_text("{")


@pytest.mark.parametrize("harm", [damage, truncate, remove, break_config])
def test_damaged_run_prints_one_line(fails, trained, tmp_path, harm):
    run_dir = tmp_path / "harmed"
    shutil.copytree(trained[0], run_dir)
    harm(run_dir)
    fails("evaluate", str(run_dir), says=str(run_dir))


def test_missing_run_prints_one_line(fails, tmp_path):
    fails("evaluate", str(tmp_path / "nothing"), says="nothing")


def test_mismatched_environment_prints_one_line(fails, trained):
    fails("evaluate", str(trained[0]), "--env", "Spinning-v0", says="environment")


def test_robot_options_are_used(fails, trained, monkeypatch):
    fails("evaluate", str(trained[0]), "--hub", "wifi", says="choose 'virtual', 'ble' or 'usb'")
    asked = []

    def make(env, options, **_):
        asked.append(options.hub)
        raise HubNotFoundError("no hub; switch it on")

    monkeypatch.setattr("bricksrl.evaluation.evaluator.make", make)
    for hub in ("ble", "ble:Rover", "usb"):
        fails("evaluate", str(trained[0]), "--hub", hub, says="no hub; switch it on")
    assert asked == ["ble", "ble:Rover", "usb"]


def test_run_on_a_lego_robot_is_not_filmed_on_a_virtual_one(fails, trained, tmp_path):
    run_dir = tmp_path / "real"
    shutil.copytree(trained[0], run_dir)
    stored = json.loads((run_dir / "config.json").read_text())
    stored["config"]["hub"] = "ble"
    (run_dir / "config.json").write_text(json.dumps(stored))
    fails("evaluate", str(run_dir), "--video", str(tmp_path / "a.mp4"), says="give --hub virtual")


@pytest.mark.parametrize(
    ("env", "says"),
    [
        ("04_own_robot.py", "its robot lies on a bench"),
        ("WalkerSim-v0", "has no virtual robot to film"),
    ],
)
def test_what_cannot_be_filmed_is_refused_before_the_first_episode(env, says, tmp_path, capsys):
    env = str(EXAMPLES / env) if env.endswith(".py") else env
    train(TrainConfig(env, "random", episodes=1, run_dir=tmp_path / "run", record=False))
    capsys.readouterr()
    assert (
        main(
            [
                "evaluate",
                str(tmp_path / "run"),
                "--episodes",
                "1",
                "--video",
                str(tmp_path / "a.mp4"),
            ]
        )
        == 2
    )
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and says in told.err
    assert not (tmp_path / "a.mp4").exists()


def test_user_is_asked_to_place_robot_each_episode(fails, trained, monkeypatch, capfd):
    task = get_task("RunAway-v0")

    def make(env, options, *, copies, seed, place):
        """A robot that needs placing by hand, as over Bluetooth."""
        twin = VirtualHub(make_body(task.robot, scene=task.scene))
        link = HubLink(twin, task.robot, task.interface)
        return HubEnv(task, lambda _seed: Connection(link, place), seed=0)

    monkeypatch.setattr("bricksrl.evaluation.evaluator.make", make)
    monkeypatch.setattr("sys.stdin", io.StringIO("\n\n"))
    assert main(["evaluate", str(trained[0]), "--episodes", "2", "--hub", "ble", "--json"]) == 0
    written = capfd.readouterr()
    assert written.err.count("press Enter") == 2
    assert json.loads(written.out)["episodes"] == 2
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert main(["evaluate", str(trained[0]), "--hub", "ble"]) == 2
    assert "nobody can be asked" in capfd.readouterr().err
