"""Failures of new users in their first hour."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from brickhub.robot import Motor, PoweredUpSensor, SensorKind
from bricksrl.agents.sac import SACSettings
from bricksrl.cli import main
from bricksrl.cli.app import run
from bricksrl.cli.new import write_template
from bricksrl.data.dataset import read_dataset
from bricksrl.envs.registry import get_task
from bricksrl.errors import DescriptionError, RunError, TwinError, WriteError
from bricksrl.evaluation.report import film_before_and_after
from bricksrl.policies import load_policy
from bricksrl.training import RunFolder, TrainConfig, train
from bricksrl.training.trust import trust
from bricktwin.twin.render.opengl import VideoWriter

EXAMPLES = Path(__file__).parents[4] / "examples"
TINY = SACSettings(hidden=(8,), batch_size=8, prefill_episodes=1, updates_per_step=0.1)
OWN = f"""
import sys
import time
from dataclasses import replace
sys.path.insert(0, {str(EXAMPLES)!r})
from importlib import import_module
PARK = import_module("03_own_task").PARK
def raises(previous, action, observation):
    raise KeyError("speed")
NAN = replace(PARK, id="Nan-v0", reward=lambda p, a, o: o[..., :1] * float("nan"))
RAISES = replace(PARK, id="Raises-v0", reward=raises)
OURS = replace(PARK, id="RunAway-v0")
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with user tasks in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two episodes of a user's robot."""
    run_dir = tmp_path_factory.mktemp("own") / "run"
    env = f"{EXAMPLES / '04_own_robot.py'}"
    train(TrainConfig(env, episodes=2, settings=TINY, run_dir=run_dir))
    return run_dir


@pytest.fixture(scope="module")
def dataset(short: Path) -> Path:
    return short / "data"


def test_robot_without_model_has_no_video(short: Path) -> None:
    with pytest.raises(TwinError, match="nothing to film, as its robot lies on a bench"):
        film_before_and_after(short, "a robot")


def test_a_trained_policy_acts_in_python(short: Path) -> None:
    policy = load_policy(short)
    assert policy.act(np.zeros(2, dtype=np.float32)).shape == (1,)


@pytest.mark.parametrize("kind", ["task", "robot", "agent"])
def test_new_file_can_be_trained(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind, "my_own.py"]) == 0
    told = capfd.readouterr().out
    assert "bricksrl check my_own.py" in told
    env, agent = ("WalkerSim-v0", "my_own.py") if kind == "agent" else ("my_own.py", "sac")
    settings = None if kind == "agent" else TINY
    short = {"max_steps": 20} if kind == "agent" else {}
    config = TrainConfig(
        env, agent, episodes=2, settings=settings, options=short, run_dir=tmp_path / "run"
    )
    assert len(train(config).episodes) == 2
    assert main(["check", "my_own.py"]) == 0
    assert not [line for line in capfd.readouterr().out.splitlines() if line.startswith("error")]
    assert kind == "agent" or get_task("my_own.py").id == "MyOwn-v0"
    assert main(["new", kind, "my_own.py"]) == 2
    assert "exists already" in capfd.readouterr().err
    assert main(["new", kind, "my-own.txt"]) == 2


def test_new_file_in_a_folder_of_any_name_is_valid(tmp_path: Path) -> None:
    """As on Windows, whose paths have backslashes."""
    for kind in ("task", "robot", "agent"):
        write_template(kind, tmp_path / "our\\users\\new" / f"my_{kind}.py")
        compile((tmp_path / "our\\users\\new" / f"my_{kind}.py").read_text(), kind, "exec")


@pytest.mark.parametrize(
    ("task", "says"),
    [
        ("NAN", r"the reward of Nan-v0 is \[nan\] in step 1"),
        ("RAISES", r"KeyError: 'speed', own\.py, line 9; correct it"),
        ("OURS", "RunAway-v0 comes with BricksRL"),
    ],
)
def test_faults_in_user_file_name_line(own: Path, fails_train, task: str, says: str) -> None:
    fails_train(f"own.py:{task}", says=says)


@pytest.fixture
def fails_train(capfd: pytest.CaptureFixture[str]):
    """Expect one error line of `train`."""
    import re

    def check(env: str, says: str) -> None:
        assert run(["train", env, "--episodes", "2", "--run", "run", "--no-record"]) == 2
        errors = capfd.readouterr().err
        assert errors.count("\n") == 1 and re.search(says, errors), errors

    return check


def test_nan_reward_in_simulation_raises(own: Path) -> None:
    from dataclasses import replace

    from bricksrl.envs.simulation import SimulatedEnv
    from bricksrl.envs.task import Kinematics

    task = replace(
        get_task("WalkerSim-v0"), id="Nan-v0", reward=lambda p, a, o: o[..., :1] * float("nan")
    )
    env = SimulatedEnv(task, Kinematics(noise=0.1), seed=0)
    with pytest.raises(DescriptionError, match="a reward of WalkerSim-v0 was not a number"):
        train(TrainConfig("WalkerSim-v0", episodes=1, run_dir=own / "run"), env=env)


def test_ports_are_letters() -> None:
    with pytest.raises(DescriptionError, match="'left' is on port 1; give the port's letter"):
        Motor("left", 1)  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match="on port 2"):
        PoweredUpSensor("light", 2, SensorKind.COLOR)  # type: ignore[arg-type]


def test_run_folder_name_has_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = [
        train(TrainConfig("RoboArmSim-v0", "random", episodes=1, record=False)).run_dir.name
        for _ in range(2)
    ]
    assert names == ["RoboArmSim-v0-random-seed-0", "RoboArmSim-v0-random-seed-0-2"]


@pytest.mark.parametrize("damage", ["cut stats", "flip stats", "cut tasks", "flip tasks", "fps"])
def test_check_finds_and_repair_fixes_damage(
    damage: str, dataset: Path, tmp_path: Path, capfd
) -> None:
    root = Path(shutil.copytree(dataset, tmp_path / "data"))
    if damage == "fps":
        path = root / "meta/info.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), "fps": "x"}))
    else:
        how, name = damage.split()
        path = root / "meta" / ("stats.json" if name == "stats" else "tasks.parquet")
        data = bytearray(path.read_bytes())
        middle = len(data) // 2
        data[middle] ^= 0xFF
        path.write_bytes(data[:middle] if how == "cut" else data)
    assert main(["data", "check", str(root)]) == 1
    told = capfd.readouterr().out
    assert path.name in told and "data repair" in told
    assert main(["data", "repair", str(root)]) == 0
    assert main(["data", "check", str(root)]) == 0


def test_repair_reports_what_it_cannot_fix(dataset: Path, tmp_path: Path, capfd) -> None:
    root = Path(shutil.copytree(dataset, tmp_path / "data"))
    min(root.glob("data/*/*.parquet")).unlink()
    assert main(["data", "check", str(root)]) == 1
    assert main(["data", "repair", str(root)]) == 1
    told = capfd.readouterr().out
    assert "--out DIR" in told
    assert main(["data", "repair", str(root), "--out", str(tmp_path / "saved")]) == 0
    assert len(read_dataset(tmp_path / "saved").rows) == 1


def test_unsaved_evaluation_is_still_shown(short: Path, tmp_path: Path, capfd) -> None:
    run_dir = Path(shutil.copytree(short, tmp_path / "run"))
    (run_dir / "evaluation.json").mkdir()
    assert main(["evaluate", str(run_dir), "--episodes", "1"]) == 2
    told = capfd.readouterr()
    assert "return " in told.out and "of 1 episode " in told.out
    assert "the evaluation is not saved" in told.err and told.err.count("\n") == 1


def test_foreign_code_needs_permission(short: Path, tmp_path: Path, fails) -> None:
    run_dir, mark = Path(shutil.copytree(short, tmp_path / "run")), tmp_path / "executed"
    evil = tmp_path / "evil.py"
    evil.write_text(f"open({str(mark)!r}, 'w').close()\n")
    config = json.loads((run_dir / "config.json").read_text())
    for part in (
        {"env": str(evil)},
        {"agent": str(evil)},
        {"settings": {**config["config"]["settings"], "network": f"{evil}:make"}},
    ):
        (run_dir / "config.json").write_text(
            json.dumps({**config, "config": {**config["config"], **part}})
        )
        for command in (["evaluate"], ["resume"], ["export", "--format", "torch-export"]):
            if command[0] != "export":
                fails(command[0], str(run_dir), says="bricksrl trust")
        assert not mark.exists()
    with pytest.raises(RunError, match="made elsewhere or changed"):
        load_policy(run_dir)
    assert trust(run_dir) == (f"{EXAMPLES / '04_own_robot.py'}", f"{evil}:make")
    assert RunFolder(run_dir).read_config().settings.network == f"{evil}:make"


def test_deeply_nested_config_prints_one_line(tmp_path: Path, fails) -> None:
    (tmp_path / "config.json").write_text("[" * 100_000)
    fails("evaluate", str(tmp_path), says="is not JSON")
    fails("trust", str(tmp_path), says="is not JSON")


def test_tuning_offline_agent_raises_without_study(tmp_path: Path, fails) -> None:
    for agent in ("bc", "random"):
        fails(
            "tune",
            "RoboArmSim-v0",
            "--agent",
            agent,
            "--folder",
            str(tmp_path / "study"),
            says="choose another agent",
        )
    assert not (tmp_path / "study").exists()


def test_two_commands_can_start_one_study(start, tmp_path: Path) -> None:
    command = (
        "tune RoboArmSim-v0 --trials 1 --steps 2 --seeds 1 --episodes 1 --folder "
        f"{tmp_path / 'study'}"
    ).split()
    both = [start(*command), start(*command)]
    said = [one.communicate(timeout=200)[1] for one in both]
    assert [one.returncode for one in both] == [0, 0], said


def test_unusual_environment_variables_are_tolerated(bricksrl, tmp_path: Path) -> None:
    environment = {
        "PYTHONIOENCODING": "ascii",
        "MPLBACKEND": "nope",
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
        "MUJOCO_GL": "osmesa",
    }
    run_dir = str(tmp_path / "run")
    done = bricksrl(
        "train",
        "RoboArmSim-v0",
        "--agent",
        "random",
        "--episodes",
        "1",
        "--run",
        run_dir,
        **environment,
    )
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert "return " in done.stdout and (tmp_path / "run/learning_curve.png").exists()


def test_settings_are_shown_where_there_is_no_width(monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    monkeypatch.setenv("COLUMNS", "0")
    assert main(["settings", "sac"]) == 0
    assert "learning_rate" in capfd.readouterr().out


def test_unwritable_video_raises(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="cannot write .* name another place"):
        VideoWriter(tmp_path / "file" / "a.mp4", 10)


@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit of a file's size")
def test_video_on_a_full_disk_raises(tmp_path: Path) -> None:
    import resource

    video, limits = VideoWriter(tmp_path / "a.mp4", 10), resource.getrlimit(resource.RLIMIT_FSIZE)
    images = np.random.default_rng(0).integers(0, 256, (60, 128, 128, 3)).astype(np.uint8)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        video.add(images[0])  # starts the encoder, with this limit
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with (
        pytest.raises(
            WriteError, match=r"cannot write .*a.mp4 \(the encoder ended\); name another place"
        ),
        video,
    ):
        list(map(video.add, images))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command",
    [
        "new task {}/my_task.py",
        "record RunAway-v0 --out {}/data",
        "record RunAway-v0 --out data --video {}/film.mp4",
        "hub program RunAway-v0 --out {}/program.py",
        "plan parts walker --out {}/parts.csv",
        "plan steps walker --out {}/walker.pdf",
        "twin record bench --out {}/log.jsonl",
        "team Tag-v0 --run {}/team",
        "tune RunAway-v0 --trials 1 --folder {}/tuning",
        "data merge {data} --out {}/data",
        "data plot {data} --out {}/data.png",
        "data export {data} --out {}/lego/data-v0",
        "evaluate {run} --video {}/film.mp4",
    ],
)
def test_unwritable_place_is_told_in_one_line(
    command: str, short: Path, tmp_path: Path, monkeypatch, capfd
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    assert main(command.format("file", data=short / "data", run=short).split()) == 2
    [told] = [line for line in capfd.readouterr().err.splitlines() if line.startswith("error")]
    assert re.fullmatch(
        r"error: cannot write file/\S+ \(Not a directory\); name another place", told
    )


def test_incomplete_video_keeps_temporary_name(tmp_path: Path) -> None:
    def film() -> None:
        with VideoWriter(tmp_path / "a.mp4", 10) as video:
            video.add(np.zeros((16, 16, 3), np.uint8))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        film()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["train", "RunAway-v0", "--agent", ""], "the name '' is empty"),
        (["train", "RunAway-v0", "--preset", ""], "no preset ''"),
        (["train", "RunAway-v0", "--episodes", "9" * 30], "give 1 or more, and up to 16,777,216"),
        (
            ["record", "RoboArmSim-v0", "--out", "new", "--episodes", "9" * 40],
            "give 1 or more, and up to 16,777,216",
        ),
        (["train", "WalkerSim-v0", "--seeds", "1000000"], "give 2 to 1000"),
        (["train", "WalkerSim-v0", "--seeds", "9" * 40], "give 2 to 1000"),
        (
            ["train", "WalkerSim-v0", "--set", f"hidden={','.join(['16384'] * 8)}"],
            "weights a network; give up to",
        ),
        (["hub", "program", "RunAway-v0", "--out", "a.txt"], "end it in .py"),
    ],
)
def test_invalid_arguments_raise_before_any_output(
    fails, arguments: list[str], says: str, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fails(*arguments, says=says)
    assert list(tmp_path.iterdir()) == []


def test_pictures_are_png_files(dataset: Path, tmp_path: Path, fails) -> None:
    fails(
        "data",
        "plot",
        str(dataset),
        "--out",
        str(tmp_path / "x.xyz"),
        says="end it in .png, .svg, .pdf",
    )


def test_hub_program_is_written_to_file(tmp_path: Path, capfd) -> None:
    assert main(["hub", "program", "RunAway-v0", "--out", str(tmp_path / "a.py")]) == 0
    assert (tmp_path / "a.py").read_text().count("\n") > 100
    assert capfd.readouterr().out.count("\n") == 1


def test_list_marks_simulations(capfd) -> None:
    assert main(["list", "--json"]) == 0
    summaries = [env["summary"] for env in json.loads(capfd.readouterr().out)["environments"]]
    assert len(set(summaries)) == len(summaries)


@pytest.mark.usefixtures("forked_children")
@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no Ctrl-C to one process")
def test_interrupted_seeds_without_results_can_restart(start, tmp_path: Path) -> None:
    process = start("train", "WalkerSim-v0", "--seeds", "2", "--run", str(tmp_path / "d"))
    while not (tmp_path / "d").exists() and process.poll() is None:
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    kept = (tmp_path / "d").exists()
    assert process.returncode == 130 and "Traceback" not in errors
    assert ("what was trained is in" if kept else "nothing was saved") in errors
    assert not kept or list((tmp_path / "d").iterdir())


def test_early_ctrl_c_shows_no_traceback() -> None:
    code = """
import signal, sys
import bricksrl.cli

class Interrupt:
    @staticmethod
    def find_spec(name, *rest):
        if name == "brickhub.cli.app":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupt)
sys.exit(bricksrl.cli.main())
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (
        130,
        "",
        "interrupted: nothing was saved\n",
    )


@pytest.mark.usefixtures("forked_children")
@pytest.mark.parametrize(
    "option", [pytest.param("--robots=2", marks=pytest.mark.slow), "--asynchronous"]
)
def test_processes_of_a_run_leave_no_warning(bricksrl, option: str) -> None:
    command = ["train", "RunAway-v0", option, "--episodes", "2", "--run", f"quiet{option}"]
    run = bricksrl(*command, "--set", "hidden=8", "--set", "batch_size=8")
    assert run.returncode == 0, run.stderr
    assert "leaked" not in run.stderr
