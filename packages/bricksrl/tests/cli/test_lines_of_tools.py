"""Lines that the commands for datasets, studies and this computer print, and what they pass on."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.cli.terminal import Interrupted
from brickhub.files import quoted
from brickhub.finding import Outcome
from bricksrl.cli import data as commands
from bricksrl.cli import doctor, hub_run
from bricksrl.cli import tune as tuning
from bricksrl.cli.data import (
    CheckData,
    ExportData,
    Import,
    Info,
    Keep,
    Merge,
    PlotData,
    Remove,
    Repair,
    Split,
)
from bricksrl.cli.tune import Tune
from bricksrl.data.selection import Selection
from bricksrl.errors import DataError, DescriptionError
from bricksrl.evaluation.tuning import Best, Tuning


def dataset(episodes: int, steps: int, root: str = "there") -> Any:
    description = SimpleNamespace(env="Walker-v0")
    return SimpleNamespace(
        rows=[None] * episodes, steps=steps, root=Path(root), description=description
    )


@pytest.mark.parametrize("camera", ["", "webcam"])
def test_summary_of_a_dataset_is_a_block_of_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], camera: str
) -> None:
    summary = SimpleNamespace(
        camera=camera,
        observation=("angle", "distance"),
        action=("left", "right"),
        rows=lambda: (("episodes", "3"),),
        to_json=lambda: '{"episodes": 3}',
    )
    monkeypatch.setattr(commands, "summarise", lambda path: summary)
    images = ", images of webcam" if camera else ""
    Info((Path("one"), Path("two"))).execute()
    block = [
        "  episodes          3",
        f"  observation       angle, distance{images}",
        "  action            left, right",
    ]
    assert capsys.readouterr().out.splitlines() == ["one:", *block, "two:", *block]
    Info((Path("one"), Path("two")), json=True).execute()
    assert capsys.readouterr().out == '{"episodes": 3}\n' * 2
    with pytest.raises(DataError, match="^no dataset is named; give its folder$"):
        Info(()).execute()


@pytest.mark.parametrize(
    ("faults", "code", "lines"),
    [((), 0, ["all is well"]), (("a row is lost", "a file is cut"), 1, None)],
)
def test_check_names_each_fault(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    faults: tuple[str, ...],
    code: int,
    lines: list[str] | None,
) -> None:
    found = [SimpleNamespace(detail=fault) for fault in faults]
    monkeypatch.setattr(commands, "check", lambda path: found)
    assert CheckData(Path("one")).execute() == code
    assert capsys.readouterr().out.splitlines() == (lines or list(faults))


@pytest.mark.parametrize("faults", [(), ("a row is lost",)])
def test_repair_says_what_it_did_and_what_is_left(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    faults: tuple[str, ...],
) -> None:
    root = tmp_path / "my data"
    description = root / commands.FILES["description"]
    description.parent.mkdir(parents=True)
    description.touch()
    asked: list[Any] = []

    def recover(path: Path, *, rebuild: bool) -> Any:
        asked.append((path, rebuild))
        return dataset(2, 9), 1, 3

    found = [SimpleNamespace(detail=fault) for fault in faults]
    monkeypatch.setattr(commands, "recover", recover)
    monkeypatch.setattr(commands, "check", lambda path: found)
    assert Repair(root).execute() == len(faults)
    assert asked == [(root, True)]
    lines = ["2 episodes; 1 new in the index, 3 unfinished files removed", *faults]
    if faults:
        lines.append(
            "save the intact episodes to a new dataset with `bricksrl data repair "
            f"{quoted(root)} --out DIR`"
        )
    assert capsys.readouterr().out.splitlines() == lines


def test_intact_episodes_of_a_damaged_dataset_are_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(commands, "salvage", lambda root, out: (dataset(1, 9), ["episode 3"]))
    assert Repair(tmp_path, Path("saved")).execute() == 0
    assert capsys.readouterr().out.splitlines() == ["lost: episode 3", "1 episode: saved"]


def test_parts_of_datasets_have_their_sizes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Any] = []

    def split(*given: Any) -> Any:
        asked.append(given)
        return dataset(8, 80), dataset(1, 1)

    monkeypatch.setattr(commands, "merge", lambda paths, out: dataset(3, 1))
    monkeypatch.setattr(commands, "split", split)
    Merge((Path("one"), Path("two")), Path("both")).execute()
    Split(Path("one"), Path("a"), Path("b")).execute()
    Split(Path("one"), Path("a"), Path("b"), share=0.5, seed=7).execute()
    assert capsys.readouterr().out.splitlines() == [
        "3 episodes, 1 step: both",
        *["8 episodes, 80 steps: a", "1 episode, 1 step: b"] * 2,
    ]
    names = (Path("one"), Path("a"), Path("b"))
    assert asked == [(*names, 0.8, 0), (*names, 0.5, 7)]


@pytest.mark.parametrize(("command", "keep"), [(Keep, True), (Remove, False)])
@pytest.mark.parametrize(
    ("conditions", "selection"),
    [
        ({"success": "yes"}, Selection(success=True)),
        ({"success": "no", "whole": "yes"}, Selection(success=False, whole=True)),
        ({"whole": "no"}, Selection(whole=False)),
        (
            {"episodes": "0-3", "return_min": -1.0, "return_max": 2.0},
            Selection("0-3", return_min=-1.0, return_max=2.0),
        ),
        ({"steps_min": 2, "steps_max": 9}, Selection(steps_min=2, steps_max=9)),
    ],
)
def test_episodes_are_chosen_by_their_conditions(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: Any,
    keep: bool,
    conditions: dict[str, Any],
    selection: Selection,
) -> None:
    asked: list[Any] = []

    def select(*given: Any, keep: bool) -> Any:
        asked.append((*given, keep))
        return dataset(2, 20)

    monkeypatch.setattr(commands, "read_dataset", lambda path: dataset(5, 50))
    monkeypatch.setattr(commands, "select", select)
    command(Path("one"), Path("new"), **conditions).execute()
    assert asked == [(Path("one"), Path("new"), selection, keep)]
    assert capsys.readouterr().out == "2 episodes, 20 steps, of 5 episodes: new\n"


@pytest.mark.parametrize("lerobot", [False, True])
def test_imported_datasets_are_named_with_their_environment(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], lerobot: bool
) -> None:
    asked: list[Any] = []

    def of_lerobot(source: Path, out: Path, *, env: str | None) -> Any:
        asked.append(("lerobot", source, out, env))
        return dataset(3, 30)

    def of_paper(source: Path, out: Path, *, env: str | None) -> Any:
        asked.append(("paper", source, out, env))
        return [(source, dataset(3, 30))]

    monkeypatch.setattr(commands, "is_lerobot", lambda source: lerobot)
    monkeypatch.setattr(commands, "load_learning", lambda: None)
    monkeypatch.setattr(commands, "import_lerobot", of_lerobot)
    monkeypatch.setattr(commands, "import_paper", of_paper)
    Import(Path("theirs"), Path("there"), "Walker-v0").execute()
    kind = "lerobot" if lerobot else "paper"
    assert asked == [(kind, Path("theirs"), Path("there"), "Walker-v0")]
    assert capsys.readouterr().out == "theirs: Walker-v0, 3 episodes, 30 steps: there\n"


@pytest.mark.parametrize(
    ("out", "given", "chosen"),
    [
        ("a.csv", None, "csv"),
        ("a.csv", "csv", "csv"),
        ("folder", "csv", "csv"),
        ("folder", None, "minari"),
        ("folder", "minari", "minari"),
    ],
)
def test_export_has_the_format_of_its_name(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    out: str,
    given: Any,
    chosen: str,
) -> None:
    written: list[Any] = []
    monkeypatch.setattr(commands, "load_learning", lambda: None)
    monkeypatch.setattr(commands, "export_csv", lambda *given: written.append(("csv", *given)))
    minari: Any = lambda *given: written.append(("minari", *given))  # noqa: E731
    monkeypatch.setattr(commands, "export_minari", minari)
    ExportData(Path("one"), Path(out), given).execute()
    assert written == [(chosen, Path("one"), Path(out))]
    assert capsys.readouterr().out == f"{chosen:7} {out}\n"


def test_table_is_no_folder_of_minaris() -> None:
    with pytest.raises(DataError) as raised:
        ExportData(Path("one"), Path("a.csv"), "minari").execute()
    assert str(raised.value) == (
        "a.csv would be a folder of Minari's; leave out --format, or the ending"
    )


def test_plot_names_its_picture(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(commands, "plot", lambda *given: drawn.append(given))
    PlotData(Path("one"), Path("a.png")).execute()
    assert drawn == [(Path("one"), Path("a.png"))]
    assert capsys.readouterr().out == "picture  a.png\n"


def test_study_is_told_trial_by_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    asked: list[Any] = []

    def tune(about: Tuning, folder: Path, trials: int, *, on_trial: Any, **named: Any) -> Best:
        asked.append((about, folder, trials, named))
        on_trial(0, -1.23456, -1.23456)
        on_trial(1, None, -1.23456)
        on_trial(2, None, None)
        return Best(None, -1.23456, 2)

    monkeypatch.setattr(tuning, "load_learning", lambda: None)
    monkeypatch.setattr(tuning, "tune", tune)
    Tune("WalkerSim-v0", "td3", steps=7, seeds=3, episodes=4).execute()
    folder = Path("tuning") / "WalkerSim-v0-td3"
    best = quoted(str(folder / "best.json"))
    assert capsys.readouterr().out.splitlines() == [
        "trial 0  return -1.235  best -1.235",
        "trial 1  ended early  best -1.235",
        "trial 2  ended early",
        "best of 2 finished trials: return -1.235",
        f"train with it   bricksrl train WalkerSim-v0 --agent td3 --settings {best}",
    ]
    Tune("WalkerSim-v0", trials=5, seed=9, folder=Path("mine"), on="ray").execute()
    assert asked == [
        (Tuning("WalkerSim-v0", "td3", 7, 3, 4), folder, 20, {"seed": 0, "on": None}),
        (Tuning("WalkerSim-v0"), Path("mine"), 5, {"seed": 9, "on": "ray"}),
    ]


@pytest.mark.parametrize("exists", [False, True])
def test_interrupted_study_says_whether_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tuning, "load_learning", lambda: None)
    monkeypatch.setattr(tuning, "tune", interrupt)
    if exists:
        (tmp_path / "study.db").touch()
    with pytest.raises(Interrupted) as raised:
        Tune("WalkerSim-v0", folder=tmp_path).execute()
    kept = f"the study is in {tmp_path}; the same command goes on with it"
    assert str(raised.value) == (kept if exists else "nothing was saved")


@pytest.mark.parametrize(
    ("code", "stderr", "library", "answer"),
    [
        (0, "", "egl", (Outcome.OK, "draws (egl)")),
        (0, "noise", None, (Outcome.OK, "draws (the library that was found)")),
        (
            1,
            "Traceback\nbricksrl.errors.TwinError: no display is here\n",
            None,
            (
                Outcome.WARNING,
                "no pictures and videos: no display is here; all the rest works without",
            ),
        ),
        (
            -11,
            "",
            None,
            (Outcome.WARNING, "no pictures and videos: exit code -11; all the rest works without"),
        ),
    ],
)
def test_graphics_are_tried_in_a_process_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
    code: int,
    stderr: str,
    library: str | None,
    answer: tuple[Outcome, str],
) -> None:
    def run(command: list[str], **named: Any) -> Any:
        assert command[-1] == doctor._DRAW and named["timeout"] == doctor._DRAW_S
        return subprocess.CompletedProcess(command, code, "", stderr)

    monkeypatch.setattr(doctor.subprocess, "run", run)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if library is not None:
        monkeypatch.setenv("MUJOCO_GL", library)
    assert doctor.check_opengl() == answer


@pytest.mark.parametrize("options", [{"realtime": True}, {"video": Path("a.mp4")}])
def test_page_of_a_program_has_a_pace_of_its_own(options: dict[str, Any]) -> None:
    from contextlib import ExitStack

    command = hub_run.Run(Path(__file__), page=True, **options)
    with ExitStack() as stack, pytest.raises(DescriptionError) as raised:
        command.streams(stack)
    assert str(raised.value) == (
        "the page has a pace of its own; leave out --page, or --video and --realtime"
    )


@pytest.mark.parametrize(
    ("has_screen", "error", "stayed"),
    [(True, None, [15.0]), (False, None, [0.0]), (True, RuntimeError("fell"), [])],
)
def test_page_stays_for_a_browser_after_a_program_that_ended(
    monkeypatch: pytest.MonkeyPatch,
    has_screen: bool,
    error: Exception | None,
    stayed: list[float],
) -> None:
    from contextlib import AbstractContextManager, ExitStack, suppress

    told: list[Any] = []
    waited: list[float] = []

    class Page(AbstractContextManager[Any]):
        url = "http://127.0.0.1:1/"

        def __init__(self, *given: Any) -> None:
            told.append(given[0])

        def stay(self, seconds: float) -> None:
            waited.append(seconds)

        def tell(self, text: str) -> None:
            told.append(text)

        def attend(self, machine: Any) -> None:
            """Nothing is shown."""

        def __exit__(self, *_: object) -> None:
            """Nothing was opened."""

    monkeypatch.setattr("bricksrl.page.program.ProgramPage", Page)
    monkeypatch.setattr(hub_run, "announce", told.append)
    monkeypatch.setattr(hub_run, "has_screen", lambda: has_screen)
    command = hub_run.Run(Path("walk.py"), others=(Path("run.py"),), page=True)
    with suppress(RuntimeError), ExitStack() as stack:
        command.streams(stack)
        if error is not None:
            raise error
    assert told == ["walk.py, run.py", "http://127.0.0.1:1/"]
    assert waited == stayed
    assert command.attend(stack) is not None
    assert hub_run.Run(Path("walk.py")).attend(stack) is None
    assert hub_run.Run(Path("walk.py")).attend_in_room() is None


def test_lists_are_plain_values(capsys: pytest.CaptureFixture[str]) -> None:
    from bricksrl.cli.envs import List

    List(json=True).execute()
    listed = json.loads(capsys.readouterr().out)
    assert list(listed) == ["environments", "arenas", "agents", "presets", "robots"]
    (walker,) = [env for env in listed["environments"] if env["id"] == "Walker-v0"]
    assert walker["robot"] == "walker" and walker["max_steps"] == 100
    assert walker["action"] == ["left_front", "right_front", "left_back", "right_back"]
    assert len(walker["observation"]) == 7
