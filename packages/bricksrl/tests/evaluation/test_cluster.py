"""Seeds on a local Ray cluster, also with a killed worker."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import ray

from brickhub.files import LOCK
from bricksrl.agents.sac import SACSettings
from bricksrl.cli.new import write_template
from bricksrl.errors import RunError
from bricksrl.evaluation import evaluate
from bricksrl.evaluation.multi_seed import (
    Keeper,
    changed_files,
    parse_on,
    train_on_cluster,
    train_on_worker,
    train_seeds,
)
from bricksrl.training import TrainConfig, train

pytestmark = pytest.mark.realtime

SWEEP = """
import json, os, signal, sys
from pathlib import Path
from bricksrl.agents.sac import SACSettings
from bricksrl.evaluation.multi_seed import train_seeds
from bricksrl.evaluation.tuning import Tuning, tune
from bricksrl.training import TrainConfig, train

SETTINGS = SACSettings(hidden=(16,), batch_size=16, updates_per_step=0.25)
folder, told, killed = Path(sys.argv[1]), [], []

def tell(seed, message):
    told.append([seed, message])
    if seed == 1 and message.get("episode") == 2 and not killed:
        killed.append(next(said["pid"] for of, said in told if of == seed and "pid" in said))
        os.kill(killed[0], getattr(signal, "SIGKILL", signal.SIGTERM))

config = TrainConfig("WalkerSim-v0", episodes=4, settings=SETTINGS, run_dir=folder / "sweep")
group = train_seeds(config, 2, jobs=2, on="ray", on_line=tell)
print(json.dumps({"returns": group.scores, "told": told, "killed": len(killed)}))
"""


def sweep_on_cluster(folder: Path) -> dict:
    done = subprocess.run(
        [sys.executable, "-c", SWEEP, str(folder)],
        check=False,
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.strip().splitlines()[-1])


def sweep_here(folder: Path) -> list[float]:
    """Returns of the same two seeds, trained in this process."""
    settings = SACSettings(hidden=(16,), batch_size=16, updates_per_step=0.25)
    returns = []
    for seed in (0, 1):
        run_dir = folder / "sweep" / f"seed-{seed}"
        train(
            TrainConfig("WalkerSim-v0", episodes=4, seed=seed, settings=settings, run_dir=run_dir)
        )
        returns.append(evaluate(run_dir).return_mean)
    return returns


@pytest.mark.slow
def test_killed_ray_worker_gives_same_numbers(tmp_path: Path) -> None:
    here = sweep_here(tmp_path / "here")
    there = sweep_on_cluster(tmp_path / "there")
    assert there["killed"] == 1
    started = [
        message["started"] for seed, message in there["told"] if seed == 1 and "started" in message
    ]
    assert len(started) == 2 and started[0] == 0 and started[1] >= 2, (
        "it was resumed, not begun anew"
    )
    assert here == there["returns"]
    for seed in (0, 1):
        one, other = (tmp_path / place / "sweep" / f"seed-{seed}" for place in ("here", "there"))
        # A lock is of the computer on which a process holds it, and is not sent.
        names = [
            sorted(
                str(path.relative_to(run))
                for path in run.rglob("*")
                if path.is_file() and path.name != LOCK
            )
            for run in (one, other)
        ]
        assert names[0] == names[1], "the same run folders"
        columns = [
            (run / "metrics.csv").read_text().splitlines()[0].split(",") for run in (one, other)
        ]
        rows = [
            [line.split(",") for line in (run / "metrics.csv").read_text().splitlines()]
            for run in (one, other)
        ]
        seconds = columns[0].index("seconds")
        assert [line[:seconds] for line in rows[0]] == [line[:seconds] for line in rows[1]]


def test_cluster_address_is_parsed() -> None:
    assert parse_on("ray") is None and parse_on("ray:10.0.0.1:6379") == "10.0.0.1:6379"
    for wrong in ("slurm", "ray:", ""):
        with pytest.raises(RunError, match="to run on"):
            parse_on(wrong)


def test_missing_ray_leaves_no_files(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="to run on"):
        train_seeds(TrainConfig("WalkerSim-v0", run_dir=tmp_path / "run"), 2, on="slurm")
    assert not (tmp_path / "run").exists()


def test_unwritable_folder_is_told(tmp_path: Path) -> None:
    """It was taken for a lost worker."""
    (tmp_path / "file").touch()
    config = TrainConfig("WalkerSim-v0", "random", episodes=1, run_dir=tmp_path / "file" / "run")
    [error] = train_on_cluster(None, [config], 1, lambda *_: None)
    assert error is not None and error.startswith("NotADirectoryError: ") and str(tmp_path) in error


def test_changed_files_return_from_worker(tmp_path: Path) -> None:
    there, here = tmp_path / "there", tmp_path / "here"
    (there / "data").mkdir(parents=True)
    (there / "checkpoint.bin").write_bytes(b"1")
    (there / "data" / "zz.parquet").write_bytes(b"rows")
    (there / "data" / ".lock").touch()  # which Windows lets nobody read while it is held
    (there / ".part-half").write_bytes(b"of a checkpoint that a learner is writing")
    known, keeper = dict[str, tuple[int, int]](), Keeper([str(here)])
    first = changed_files(there, known)
    assert list(first) == ["data/zz.parquet", "checkpoint.bin"], "the checkpoint comes last"
    keeper.keep(0, first, {"episode": 1})
    (there / "checkpoint.bin").write_bytes(b"22")
    second = changed_files(there, known)
    assert second == {"checkpoint.bin": b"22"}
    keeper.keep(0, second, {"episode": 2})
    assert keeper.files(0) == {"checkpoint.bin": b"22", "data/zz.parquet": b"rows"}
    assert (
        keeper.messages() == [(0, {"episode": 1}), (0, {"episode": 2})] and keeper.messages() == []
    )


def test_error_of_user_code_on_worker_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was taken for a lost worker."""
    task = tmp_path / "my_task.py"
    write_template("task", task)
    task.write_text(
        task.read_text().replace(
            "return -error_mm(observation) / 100.0", "raise ZeroDivisionError('by hand')"
        )
    )
    monkeypatch.setattr(ray, "get", lambda value: value)
    keeper = SimpleNamespace(
        files=SimpleNamespace(remote=lambda number: {}),
        keep=SimpleNamespace(remote=lambda number, files, message: None),
    )
    config = TrainConfig(str(task), episodes=1).to_dict()
    error = train_on_worker(0, config, keeper)
    assert error is not None and re.fullmatch(
        r"ZeroDivisionError: by hand.*my_task\.py.*; correct it", error
    )
