"""``bricksrl evaluate``."""

from __future__ import annotations

import io
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from brickhub.errors import HubNotFoundError
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.cli import main
from bricksrl.cli.evaluate import Export, _is_own, print_comparison
from bricksrl.envs import get_task
from bricksrl.envs.connection import Connection
from bricksrl.envs.env import HubEnv
from bricksrl.errors import RunError
from bricksrl.evaluation.comparison import compare
from bricksrl.training import Episode, Phase, RunFolder, TrainConfig, train
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


@pytest.mark.parametrize(("agents", "seeds", "says"), [(1, 1, False), (2, 1, True), (2, 5, False)])
def test_comparison_says_where_chance_decides(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    agents: int,
    seeds: int,
    says: bool,
) -> None:
    """Between two agents with few seeds, and of none for a single one."""
    paths = [
        tmp_path / agent / str(seed) for agent in ("sac", "td3")[:agents] for seed in range(seeds)
    ]
    for path in paths:
        folder = RunFolder(path)
        path.mkdir(parents=True)
        seed = int(path.name)
        folder.write_config(TrainConfig("Walker-v0", path.parent.name, seed=seed))
        folder.write_episodes([Episode(1, Phase.TRAIN, 1200, 10, -1.0 - seed, None)])
    print_comparison(compare(paths))
    said = " ".join(capsys.readouterr().out.split())
    assert ("chance with so few: train 5 seeds of each (`--seeds 5`)" in said) == says
    assert ("with probability" in said) == (seeds == 5) and "1,200" in said
    assert ("needs 5 seeds" in said) == (seeds < 5)


def test_policy_that_comes_with_bricksrl_is_named_by_its_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _is_own(Path("Walker-v1"))
    assert not _is_own(Path("runs/walker")), "there is no such run, which is said elsewhere"
    (tmp_path / "Walker-v1").mkdir()
    assert not _is_own(Path("Walker-v1")), "a folder of that name is a run"


@pytest.mark.parametrize(("best", "which"), [(False, "last"), (True, "best")])
def test_export_is_of_the_checkpoint_that_was_asked_for(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    best: bool,
    which: str,
) -> None:
    asked: list[Any] = []

    def export(*given: Any, which: str) -> float:
        asked.append((*given, which))
        return 0.0015

    monkeypatch.setattr("bricksrl.cli.evaluate.load_learning", lambda: None)
    monkeypatch.setattr("bricksrl.policies.export.export_model", export)
    out = tmp_path / "policy.onnx"
    Export(Path("runs/one"), out, "onnx", best=best).execute()
    assert asked == [(Path("runs/one"), out, "onnx", which)]
    says = f"written  {out}  (its actions differ by 0.0015 at most from the policy's)\n"
    assert capsys.readouterr().out == says
    with pytest.raises(RunError, match="is exported with --format hub only; add it"):
        Export(Path("Walker-v1"), out, "onnx").execute()
