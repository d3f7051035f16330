"""What somebody meets in the first hour and after a mishap: one plain line that says what happened,
and what to do."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bricksrl.cli import main
from bricksrl.cli.app import parse
from bricksrl.cli.terminal import telling
from bricksrl.data.edit import salvage
from bricksrl.envs.make import COPIES_PER_CORE
from bricksrl.errors import RunError

RECORD = ("record", "RunAway-v0", "--episodes", "3", "--out")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("recorded") / "ds"
    assert main([*RECORD, str(out)]) == 0
    return out


def copy_of(dataset: Path, tmp_path: Path) -> Path:
    import shutil

    return Path(shutil.copytree(dataset, tmp_path / "ds"))


def test_advice_after_a_lost_row_works(recorded, tmp_path, fails, capfd):
    dataset = copy_of(recorded, tmp_path)
    (dataset / "meta/episodes/chunk-000/file-002.parquet").unlink()
    fails("data", "check", str(dataset), says=f"`bricksrl data repair {dataset} --out NEW`")
    fails(
        "data",
        "repair",
        str(dataset),
        says=f"save them with `bricksrl data repair {dataset} --out NEW`",
    )
    fails(*RECORD, str(dataset), says="--out NEW")
    assert main(["data", "repair", str(dataset), "--out", str(tmp_path / "saved")]) == 0
    assert "2 episodes" in capfd.readouterr().out
    assert main(["data", "check", str(tmp_path / "saved")]) == 0


def test_record_into_a_dataset_says_so_and_refuses_a_damaged_one(recorded, tmp_path, capfd):
    dataset = copy_of(recorded, tmp_path)
    assert main([*RECORD, str(dataset)]) == 0
    assert f"{dataset} has 3 episodes already, which are kept" in capfd.readouterr().err
    (dataset / "data/chunk-000/file-001.parquet").write_bytes(b"damaged")
    assert main([*RECORD, str(dataset)]) == 2
    told = capfd.readouterr()
    assert (
        "is damaged" in told.err
        and "--out NEW` saves what is whole" in told.err
        and "episode 1" not in told.out
    )
    saved, lost = salvage(dataset, tmp_path / "saved")
    assert len(saved.rows) == 5 and lost


WRONG = (
    (("train", "Walker-v9"), "did you mean 'Walker-v2'?"),
    (("train", "Walker-v1", "--agent", "sax"), "did you mean 'sac'?"),
    (("train", "Walker-v1", "--option", "speed=3"), "has no option speed"),
    (("train", "Walker-v1", "--hub", "blue"), "there is no hub 'blue'"),
    (("train", "Walker-v1", "--run", str(Path(__file__).parent)), "exists already"),
    (("record", "Walker-v9", "--out", "x"), "did you mean 'Walker-v2'?"),
    (("demo", "Walker-v9"), "did you mean 'Walker-v2'?"),
    (("demo", "WalkerSim-v0"), "has no robot to show"),
    (("play", "nope"), "; or the folder of a run: a folder with a config.json"),
    (("record", "", "--out", "x"), "the name '' is empty; give one, or leave the option out"),
    (("demo", "--policy", "bset"), "has no policy 'bset'; choose random, scripted"),
    (
        ("list", "\N{EN DASH}json"),
        "\N{EN DASH}json begins with the dash of a word processor; type --json",
    ),
)


@pytest.fixture(scope="module")
def refused():
    """Exit code, text and whether torch was loaded of each of the `WRONG` words, in one process."""
    code = """
import contextlib, io, json, sys
from bricksrl.cli import main
for words in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        try:
            code = main(words)
        except SystemExit as end:
            code = end.code
    print(json.dumps([code, said.getvalue(), "torch" in sys.modules]))
"""
    words = json.dumps([words for words, _ in WRONG])
    done = subprocess.run(
        [sys.executable, "-c", code, words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and not done.stderr, done.stderr
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    return dict(zip((words for words, _ in WRONG), answers, strict=True))


@pytest.mark.parametrize(("words", "says"), WRONG)
def test_wrong_words_are_refused_before_torch_is_loaded(refused, words, says):
    """Loading torch takes seconds."""
    code, said, is_torch_loaded = refused[words]
    assert code == 2 and says in said and said.count("\n") == 1, said
    assert not is_torch_loaded


ONLY_ROBOT = """
from brickhub.robot import HubKind, Robot
ROVER = Robot("rover", HubKind.PRIME)
"""


def test_file_with_a_robot_alone_is_told_from_one_whose_plan_is_missing(
    fails, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("rover.py").write_text(ONLY_ROBOT)
    says = "rover.py has no task; `bricksrl new task FILE` writes a file with one; "
    fails("check", "rover.py", says=f"{says}`bricksrl hub check rover.py --hub virtual` checks")
    Path("no_plan.py").write_text(ONLY_ROBOT.replace(".PRIME", ".PRIME, plan='rover.ldr'"))
    fails("check", "no_plan.py", says=f"rover.ldr: No such file or directory in {tmp_path}; name")


def test_run_in_place_of_an_environment_is_told(fails, tmp_path):
    (tmp_path / "config.json").write_text("{}")
    fails("train", str(tmp_path), says=f"is a run; `bricksrl resume {tmp_path}` goes on with it")


def test_more_copies_than_this_computer_has_room_for_are_refused(fails, tmp_path):
    most = COPIES_PER_CORE * (os.cpu_count() or 1)
    words = ("train", "Walker-v1", "--num-envs", str(most + 1), "--run", str(tmp_path / "run"))
    fails(*words, says=f"each is a process, and this computer has {os.cpu_count()} core")
    assert not (tmp_path / "run").exists()


def test_own_task_needs_no_writable_home(tmp_path, monkeypatch):
    from bricksrl.training import trust

    home = tmp_path / "home"
    home.write_text("a file is in the place of the settings folder")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code, data = ("my_task.py",), b'{"env": "my_task.py"}'
    with pytest.raises(RunError, match="made elsewhere"):
        trust.require_trusted(tmp_path / "config.json", data, code)
    trust.remember(data)
    trust.require_trusted(tmp_path / "config.json", data, code)
    if sys.platform == "win32":  # where temporary files are the user's own
        return
    (folder,) = tmp_path.glob("bricksrl-trusted-*")
    folder.chmod(0o777)
    with pytest.raises(RunError, match="made elsewhere"):  # anybody may have written there
        trust.require_trusted(tmp_path / "config.json", data, code)


def test_long_work_is_told_from_time_to_time(capfd, monkeypatch):
    monkeypatch.setattr("bricksrl.cli.terminal._TELL_S", 0.05)
    with telling("filming"):
        time.sleep(0.2)
    first, second, *_ = capfd.readouterr().out.splitlines()
    assert first == "filming" and second.startswith("filming, for 0 s now")


def test_films_can_be_left_out(tmp_path, capfd):
    assert parse(["train", "RunAway-v0"]).film and not parse(["resume", "x", "--no-film"]).film
    run = tmp_path / "run"
    assert (
        main(
            [
                "train",
                "RunAway-v0",
                "--agent",
                "random",
                "--episodes",
                "1",
                "--no-film",
                "--run",
                str(run),
            ]
        )
        == 0
    )
    assert "video           none: it was left out (--no-film)" in capfd.readouterr().out
    assert not list(run.glob("*.mp4")) and (run / "report.html").exists()


def test_film_of_a_killed_process_does_not_stay(tmp_path):
    run = tmp_path / "run"
    words = ["train", "RunAway-v0", "--agent", "random", "--episodes", "1", "--no-film"]
    assert main([*words, "--run", str(run)]) == 0
    (run / ".part-x.mp4").write_bytes(b"half a film")
    assert main(["resume", str(run), "--episodes", "2", "--no-film"]) == 0
    assert not list(run.glob(".part-*"))


def test_narrow_terminal_lists_every_environment_on_few_lines(monkeypatch, capfd):
    monkeypatch.setenv("COLUMNS", "40")
    assert main(["list"]) == 0
    told = capfd.readouterr().out
    assert "RoboArm_mixed-v0" in told and max(map(len, told.splitlines())) <= 40
    assert "robot  " not in told.splitlines()[0]


def test_opengl_that_was_asked_for_is_named():
    """After a library that does not work was replaced by none."""
    code = (
        "from bricktwin.twin.make_body import check_mujoco; check_mujoco()\n"
        "from bricksrl.cli.doctor import check_opengl\n"
    )
    environment = {**os.environ, "MUJOCO_GL": "bogus"}
    command = [sys.executable, "-c", f"{code}print(check_opengl())"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert "MUJOCO_GL=bogus" in done.stdout and "disable" not in done.stdout, done.stdout


@pytest.mark.realtime
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts processes in /proc")
def test_sigterm_ends_a_training_whose_processes_start(start, tmp_path):
    process = start(
        "train", "Walker-v1", "--num-envs", "2", "--no-film", "--run", str(tmp_path / "run")
    )

    def children() -> list[str]:
        return Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()

    while len(children()) < 2:
        assert process.poll() is None
        time.sleep(0.05)
    started = children()
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 130
    end_s = time.monotonic() + 20
    while any(Path(f"/proc/{child}").exists() for child in started) and time.monotonic() < end_s:
        time.sleep(0.1)
    assert not [child for child in started if Path(f"/proc/{child}").exists()]
