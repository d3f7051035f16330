"""Progress of several seeds, the list of studies, and what an interrupted study or tuning tells."""

from __future__ import annotations

from pathlib import Path

import pytest

from bricksrl.cli import main
from bricksrl.cli.progress import SeedsProgress
from bricksrl.cli.tune import StudyCommand
from bricksrl.errors import DescriptionError, RunError, UnknownNameError


def test_progress_lines_show_episodes_and_lost_workers(capsys: pytest.CaptureFixture[str]) -> None:
    with SeedsProgress(range(2), 3, live=False) as progress:
        progress.tell(0, {"started": 0, "pid": 1, "node": "one"})
        progress.tell(0, {"episode": 1, "return": 2.5})
        progress.tell(0, {"started": 1, "pid": 2, "node": "two"})
        progress.tell(0, {"evaluated": 7.0})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "seed 0  episode 1/3  return 2.5"
    assert lines[1] == "seed 0  its worker was lost; resumed after episode 1"
    assert lines[2].endswith("trained and evaluated  return 7")
    first, second = progress.tasks
    assert [first.description, second.description] == ["0", "1"] and [
        first.completed,
        second.completed,
    ] == [1, 0]
    assert (
        first.fields == {"value": "return 7", "state": "evaluated", "node": "two"}
        and second.fields["state"] == "waiting"
    )


def test_studies_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    StudyCommand().execute()
    listed = capsys.readouterr().out
    assert "sim-to-robot" in listed and "on two cores" in listed
    with pytest.raises(UnknownNameError, match="no benchmark 'poetry'"):
        StudyCommand("poetry").execute()
    with pytest.raises(DescriptionError, match="jobs is 0"):
        StudyCommand("agents", jobs=0).execute()


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (StudyCommand(quick=True), "--quick has no effect without a study's name"),
        (
            StudyCommand("datasets", only=("bc-*",)),
            "--only bc-\\*; `python -m benchmarks datasets --help`",
        ),
    ],
)
def test_study_ignores_no_option(command: StudyCommand, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        command.execute()


def test_study_shows_published_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    benchmarks = Path(__file__).parents[4] / "benchmarks"
    StudyCommand("datasets", folder=tmp_path / "study", benchmarks=benchmarks).execute()
    page = tmp_path / "study" / "study.md"
    assert str(page) in capsys.readouterr().out and "-69.1" in page.read_text()


def test_study_outside_of_a_clone_says_where_studies_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RunError, match=r"not in .*elsewhere; run this in the folder of"):
        StudyCommand("agents", benchmarks=tmp_path / "elsewhere").execute()
    monkeypatch.setattr(
        "bricksrl.cli.tune.__file__",
        str(tmp_path / "site-packages" / "bricksrl" / "cli" / "study.py"),
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        RunError,
        match="in the folder benchmarks of the repository, not in this package; run this "
        "in the folder of the repository",
    ):
        StudyCommand("agents").execute()


def test_interrupted_tuning_tells_what_is_there(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def press() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("bricksrl.cli.tune.load_learning", press)
    assert main(["tune", "RoboArmSim-v0", "--folder", str(tmp_path / "study")]) == 130
    assert capfd.readouterr().err == "interrupted: nothing was saved\n"


@pytest.mark.parametrize("started", [False, True])
def test_interrupted_study_tells_what_is_there(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    started: bool,
) -> None:
    def press(_session: object) -> None:
        if started:
            (tmp_path / "study").mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.datasets.main", press)
    assert main(["study", "datasets", "--quick", "--folder", str(tmp_path / "study")]) == 130
    kept = (
        f"what is finished is in {tmp_path / 'study'}; the same command goes on"
        if started
        else "nothing was saved"
    )
    assert capfd.readouterr().err == f"interrupted: {kept}\n"
