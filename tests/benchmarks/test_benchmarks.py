"""Benchmarks: one registry, one command, finished parts kept, results with machine and versions."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks import ablation, learning, session
from benchmarks.__main__ import run
from benchmarks.parts import Failure, outcomes
from benchmarks.registry import BENCHMARKS
from benchmarks.session import RESULTS
from brickhub.cli.terminal import Interrupted
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.errors import BricksError, DescriptionError, RunError, UnknownNameError
from bricksrl.evaluation.multi_seed import connected

ROOT = Path(__file__).parents[2]
MARK = {
    "mark": 100,
    "return": 2.5,
    "success_rate": 0.5,
    "steps": 100,
    "episodes": 1,
    "cpu_s": 1.0,
    "wall_s": 1.0,
}


@pytest.mark.parametrize("name", BENCHMARKS)
def test_each_name_answers_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="^0$"):
        run([name, "--help"])
    subject = (import_module(f"benchmarks.{BENCHMARKS[name].module}").__doc__ or "").partition(
        "\n"
    )[0]
    shown = capsys.readouterr().out
    assert subject in shown and "--quick" in shown and "--again" in shown


def test_each_benchmark_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 0
    listed = capsys.readouterr().out
    assert all(f"  {name} " in listed and one.title in listed for name, one in BENCHMARKS.items())
    modules = {
        path.stem
        for path in (ROOT / "benchmarks").glob("*.py")
        if "def main(session: Session)" in path.read_text(encoding="utf-8")
    }
    assert modules == {one.module for one in BENCHMARKS.values()}


def test_unknown_name_and_wrong_options_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="no benchmark 'poetry'"):
        run(["poetry"])
    with pytest.raises(DescriptionError, match="jobs is 0"):
        run(["agents", "--jobs", "0"])
    with pytest.raises(
        DescriptionError, match=r"--only bc-\*; `python -m benchmarks datasets --help`"
    ):
        run(["datasets", "--only", "bc-*"])


@pytest.mark.parametrize("started", [False, True])
def test_interrupted_study_tells_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, started: bool
) -> None:
    def press(_session: object) -> None:
        if started:
            (tmp_path / "study").mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.datasets.main", press)
    kept = "what is finished is in .*study; the same command" if started else "nothing was saved"
    with pytest.raises(Interrupted, match=kept):
        run(["datasets", "--quick", "--folder", str(tmp_path / "study")])


@pytest.mark.parametrize(
    ("name", "options"),
    [("link_fuzz", ["--seconds", "1"]), pytest.param("baselines", [], marks=pytest.mark.slow)],
)
def test_quick_form_runs(name: str, options: list[str], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks", name, "--quick", *options]
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), *sys.path))}
    subprocess.run(command, cwd=tmp_path, env=variables, check=True, timeout=200)
    (result,) = tmp_path.glob(f"studies/{name}-quick/study.json")
    written = json.loads(result.read_text())
    assert {"processor", "cores", "system"} == set(written["machine"]) and "mujoco" in written[
        "versions"
    ]


def test_finished_parts_are_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[object] = []
    real = ablation.run

    def interrupted(*job: object) -> object:
        made.append(job[-1])
        if len(made) == 2:
            raise KeyboardInterrupt
        return real(*job)  # type: ignore[arg-type]

    monkeypatch.setattr(learning, "EVALUATED_EPISODES", 2)
    folder, words = (
        tmp_path / "here",
        ["ablation", "--quick", "--folder", str(tmp_path / "here"), "--jobs", "1"],
    )
    monkeypatch.setattr(ablation, "run", interrupted)
    with pytest.raises(
        Interrupted, match=r"what is finished is in .*here; the same command goes on"
    ):
        run(words)
    assert len(list(folder.glob("*-default-*.json"))) == 1 and not (folder / "study.json").exists()
    assert run(words) == 0
    assert made == [0, 1, 1] and "1 of 2 parts are in" in capsys.readouterr().out
    assert len(_returns(folder)) == 2
    assert "| `RoboArmSim-v0` | sac | 2 | 100 | `default` |" in (folder / "study.md").read_text()
    monkeypatch.setattr(ablation, "run", lambda *job: [{**MARK, "return": job[-1]}])
    assert run(words) == 0 and _returns(folder) != [0, 1]
    assert run([*words, "--again"]) == 0 and _returns(folder) == [0, 1]


def test_killed_process_raises_one_line(tmp_path: Path) -> None:
    parts: dict[Path, tuple[int]] = {tmp_path / f"{number}.json": (9,) for number in range(2)}
    with pytest.raises(
        RunError,
        match="a process was killed, maybe for lack of memory; repeat the command with "
        "fewer --jobs",
    ):
        list(outcomes(os._exit, parts, 2))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there are no process groups")
def test_ctrl_c_keeps_no_training_that_it_has_ended(tmp_path: Path) -> None:
    options = [
        "--episodes",
        "60",
        "--seeds",
        "4",
        "--jobs",
        "2",
        "--folder",
        str(tmp_path / "parts"),
    ]
    command = [sys.executable, "-m", "benchmarks", "robots", "--envs", "RunAway-v0", *options]
    runs = tmp_path / "runs"
    runs.mkdir()
    variables = {**os.environ, "TMPDIR": str(runs)}
    with subprocess.Popen(
        command, cwd=ROOT, env=variables, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        while len(list(runs.rglob("metrics.csv"))) < 2:
            assert process.poll() is None
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.endswith("interrupted: nothing was saved\n") and "Traceback" not in errors
    assert not (tmp_path / "parts").exists() and len(list(runs.rglob("metrics.csv"))) == 0


def _returns(folder: Path) -> list[float]:
    found = json.loads((folder / "study.json").read_text())["environments"]["RoboArmSim-v0"]["sac"][
        "variants"
    ]
    return list(found["default"]["returns"])


@pytest.mark.parametrize("damaged", ['{"outcome": ', "[1]", "{}"])
def test_damaged_part_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damaged: str
) -> None:
    monkeypatch.setattr(ablation, "run", lambda *job: [MARK])
    words = ["ablation", "--quick", "--folder", str(tmp_path), "--jobs", "1"]
    assert run(words) == 0
    part, _ = tmp_path.glob("*-default-*.json")
    part.write_text(damaged)
    assert run(words) == 0
    assert json.loads(part.read_text()) == {"outcome": [MARK]} and _returns(tmp_path) == [2.5, 2.5]


def _root(value: float) -> float:
    if value < 0:
        raise RunError(f"{value} has no root")
    return value**0.5


@pytest.mark.realtime
def test_parts_are_made_on_a_cluster(tmp_path: Path) -> None:
    """Its workers have the package only, not the benchmarks."""
    with connected(None, 1) as ray:
        ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
        good, bad = outcomes(
            _root, {tmp_path / "good.json": (4.0,), tmp_path / "bad.json": (-1.0,)}, ray=ray
        )
    assert good == 2.0 and isinstance(bad, Failure) and bad == "-1.0 has no root"
    assert (
        json.loads((tmp_path / "good.json").read_text()) == {"outcome": 2.0}
        and not (tmp_path / "bad.json").exists()
    )


def test_failed_part_is_one_line(tmp_path: Path) -> None:
    words = [
        "teachers",
        "--folder",
        str(tmp_path),
        "--ways",
        "alone",
        "--seeds",
        "1",
        "--episodes",
        "0",
    ]
    with pytest.raises(RunError, match=r"^alone-0-0: .*episodes is 0"):
        run(words)


@pytest.mark.parametrize("name", ["offline", "datasets", "ablation", "learning"])
def test_published_result_is_shown(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "shown"
    assert run([name, "--folder", str(folder)]) == 0
    sections = (
        (folder / "study.md").read_text(encoding="utf-8").removeprefix("## ").split("\n\n## ")
    )
    published = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert len(sections) == 1 + len(BENCHMARKS[name].also) and all(
        f"## {section}" in published for section in sections
    )
    monkeypatch.setattr(session, "RESULTS", tmp_path)
    for content in ("", "[1]", '{"machine": 1}'):
        (tmp_path / f"{name}.json").write_text(content)
        with pytest.raises(
            BricksError,
            match=r"json is not the result of a benchmark; delete it, and the same command "
            r"measures",
        ):
            run([name, "--folder", str(folder)])


def test_mistakes_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"no benchmark 'robot' \(did you mean 'robots'\?\)"):
        run(["robot"])
    with pytest.raises(
        DescriptionError,
        match="--secnds 1; `python -m benchmarks link_fuzz --help` lists the options",
    ):
        run(["link_fuzz", "--secnds", "1"])


def test_reference_returns_are_those_of_the_results() -> None:
    found = json.loads((RESULTS / "baselines.json").read_text())["environments"]
    for env, lines in REFERENCES.items():
        for label, policy in (("random", "random"), ("by hand", "scripted")):
            assert lines[label] == found[env][policy]["return_mean"], (env, label)
