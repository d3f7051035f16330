"""What the commands of training make of their options: configurations, displays, and lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.cli.terminal import Interrupted, print_line
from brickhub.files import quoted
from bricksrl.agents import preset
from bricksrl.cli import progress as progresses
from bricksrl.cli import train as commands
from bricksrl.cli.app import parse
from bricksrl.cli.train import Resume, Train, TrainOffline, run_folder, run_training
from bricksrl.errors import DescriptionError, RunError, StoppedError
from bricksrl.page.server import PageOptions
from bricksrl.training import Episode, Phase, RunFolder, TrainConfig
from bricksrl.training.callbacks import CallbackList, Progress, RunResult
from bricksrl.training.config import RunOptions
from bricksrl.training.run import resume, train


def write_run(path: Path, config: TrainConfig, episodes: int = 1) -> Path:
    """A folder of a run with its episodes, of 10 steps each."""
    path.mkdir(parents=True)
    folder = RunFolder(path)
    folder.write_config(config)
    done = range(1, episodes + 1)
    folder.write_episodes([Episode(k, Phase.TRAIN, 10 * k, 10, -1.0, None) for k in done])
    return path


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Trainings that were begun: what they run, their config, address, and other options."""
    trainings: list[Any] = []

    def begin(run: Any, config: TrainConfig, address: Any, **named: Any) -> None:
        trainings.append((run, config, address, named))

    monkeypatch.setattr(commands, "load_learning", lambda: None)
    monkeypatch.setattr(commands, "run_training", begin)
    return trainings


def test_training_is_run_as_it_was_asked_for(tmp_path: Path, begun: list[Any]) -> None:
    path = str(tmp_path / "run")
    parse(("train", "WalkerSim-v0", "--run", path)).execute()
    parse(("train", "WalkerSim-v0", "--run", path, "--page", "--no-film")).execute()
    first, second = begun
    run, config, address, named = first
    assert (run.func, run.args) == (train, (config,))
    assert (config.env, config.agent, config.run_dir) == ("WalkerSim-v0", "sac", Path(path))
    assert (address, named) == (None, {"film": True})
    assert second[2:] == (PageOptions(), {"film": False})


@pytest.mark.parametrize(
    ("device", "env", "keys", "realtime"),
    [
        ("keyboard", "RunAway-v0", False, True),
        ("gamepad", "RunAway-v0", None, True),
        ("keyboard", "WalkerSim-v0", False, False),
    ],
)
def test_human_who_takes_over_has_the_keyboard_alone(
    monkeypatch: pytest.MonkeyPatch,
    begun: list[Any],
    device: str,
    env: str,
    keys: bool | None,
    realtime: bool,
) -> None:
    """A virtual robot moves in real time then; a simulation is paced."""
    asked: list[Any] = []

    @contextmanager
    def driving(*given: Any, in_charge: bool) -> Iterator[str]:
        asked.append((*given[:2], given[2].id, in_charge))
        yield "a human"

    monkeypatch.setattr(commands, "driving", driving)
    parse(("train", env, "--take-over", device)).execute()
    ((_, config, _, named),) = begun
    assert asked == [(device, env, env, False)]
    assert named == {"driver": "a human", "keys": keys, "film": True}
    assert config.realtime is realtime


@pytest.mark.parametrize(("words", "on"), [((), None), (("--on", "ray:here"), "ray:here")])
def test_several_seeds_are_trained_where_it_was_said(
    monkeypatch: pytest.MonkeyPatch, begun: list[Any], words: tuple[str, ...], on: str | None
) -> None:
    trained: list[Any] = []
    monkeypatch.setattr(commands, "train_seeds", lambda *given: trained.append(given))
    parse(("train", "WalkerSim-v0", "--seeds", "3", "--seed", "7", *words)).execute()
    ((config, count, where),) = trained
    assert (config.env, config.seed, count, where) == ("WalkerSim-v0", 7, 3, on)
    assert not begun


def test_what_goes_with_no_training_is_refused(
    tmp_path: Path, begun: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = write_run(tmp_path / "my run", TrainConfig("WalkerSim-v0"))
    refusals = {
        ("--on", "ray"): "a single run needs no cluster; give --seeds, or omit --on",
        ("--run", str(run)): (f"{run} exists already; resume that run or choose another folder"),
    }
    for words, message in refusals.items():
        with pytest.raises((DescriptionError, RunError)) as raised:
            parse(("train", "WalkerSim-v0", *words)).execute()
        assert str(raised.value) == message
    with pytest.raises(DescriptionError) as raised:
        Train("my run").execute()
    assert str(raised.value) == (
        f"my run is a run; `bricksrl resume {quoted('my run')}` goes on with it, and `bricksrl "
        f"train ENV --from {quoted('my run')}` lets its agent go on in a new one"
    )
    with pytest.raises(DescriptionError) as raised:
        Train("WalkerSim-v0", resume=run).execute()
    assert str(raised.value) == ("a run that is resumed has an environment; omit ENV or --resume")
    assert not begun


def test_evaluations_have_their_number_of_episodes(begun: list[Any]) -> None:
    learning = RunOptions(eval_every=2, eval_episodes=9)
    Train("WalkerSim-v0", learning=learning).execute()
    Train("WalkerSim-v0", learning=RunOptions(eval_every=2)).execute()
    configs = [config for _, config, _, _ in begun]
    assert [(each.eval_every, each.eval_episodes) for each in configs] == [(2, 9), (2, 5)]


def test_run_goes_on_with_the_agent_and_the_settings_it_had(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = replace(preset("default", "td3"), gamma=0.5)
    old = TrainConfig("WalkerSim-v0", "td3", settings=settings, base="scripted")
    write_run(tmp_path / "old", old)
    learning = RunOptions(start="old")
    on = Train("WalkerSim-v0", learning=learning).config("WalkerSim-v0")
    assert (on.agent, on.settings, on.base) == ("td3", settings, "scripted")
    assert on.start == str(Path("old").absolute())
    anew = Train("WalkerSim-v0", preset="default", learning=learning).config("WalkerSim-v0")
    assert (anew.agent, anew.settings) == ("td3", preset("default", "td3"))
    other = Train("WalkerSim-v0", agent="sac", learning=learning).config("WalkerSim-v0")
    assert other.agent == "sac" and other.settings.gamma != 0.5
    changed = Train("WalkerSim-v0", changes=("tau=0.25",), learning=learning)
    assert changed.config("WalkerSim-v0").settings == replace(settings, tau=0.25)
    write_run(tmp_path / "other", TrainConfig("WalkerSim-v0"))
    based = Train("WalkerSim-v0", learning=RunOptions(start="old", base="other"))
    assert based.config("WalkerSim-v0").base == str(Path("other").absolute())


@pytest.mark.parametrize(
    ("flags", "asynchronous"),
    [
        ({}, False),
        ({"asynchronous": True}, True),
        ({"synchronous": True}, False),
    ],
)
def test_learner_is_beside_the_robot_where_it_was_asked_for(
    flags: dict[str, bool], asynchronous: bool
) -> None:
    config = Train("WalkerSim-v0", **flags).config("WalkerSim-v0")
    assert config.asynchronous is asynchronous


def test_unnamed_run_lies_under_its_names_and_the_time() -> None:
    found = run_folder(None, "my tasks/far.py", "my_agent.py", 7)
    assert re.fullmatch(r"far\.py-my_agent\.py-7-\d{8}-\d{6}", found.name)
    assert found.parent == Path("runs")
    assert run_folder(Path("mine"), "far.py", "sac", 7) == Path("mine")


def test_offline_training_learns_from_the_data_alone(tmp_path: Path, begun: list[Any]) -> None:
    data = tmp_path / "data"
    TrainOffline("WalkerSim-v0", data).execute()
    run = Path("mine")
    options = {"agent": "bc", "updates": 30, "episodes": 3, "seed": 5, "run": run, "film": False}
    TrainOffline("WalkerSim-v0", data, preset="paper", page=True, **options).execute()
    first, second = begun
    _, config, address, named = first
    assert (config.env, config.agent, config.data) == ("WalkerSim-v0", "iql", str(data))
    assert (config.updates, config.episodes, config.seed) == (5000, 10, 0)
    assert config.settings == preset("default", "iql")
    assert (address, named) == (None, {"can_drive": False, "film": True})
    run_, config, address, named = second
    assert (run_.func, run_.args) == (train, (config,))
    assert (config.agent, config.updates, config.episodes, config.seed) == ("bc", 30, 3, 5)
    assert config.settings == preset("paper", "bc") and config.run_dir == run
    assert (address, named) == (PageOptions(), {"can_drive": False, "film": False})


def test_resumed_run_goes_on_as_it_was_asked_to(tmp_path: Path, begun: list[Any]) -> None:
    path = write_run(tmp_path / "run", TrainConfig("WalkerSim-v0", seed=3))
    Resume(path).execute()
    Train(resume=path, episodes=9, page=True, film=False).execute()
    first, second = begun
    run, config, address, named = first
    assert (run.func, run.args, run.keywords) == (resume, (path,), {"episodes": None})
    assert config.seed == 3
    assert (address, named) == (None, {"film": True})
    assert second[0].keywords == {"episodes": 9}
    assert second[2:] == (PageOptions(), {"film": False})


class Live(AbstractContextManager[Any]):
    """A page that is not served."""

    driver = "who sits at the page"

    def __init__(self) -> None:
        self.states: list[str] = []
        self.attached: list[Any] = []
        self.said = ""
        self.board = SimpleNamespace(
            update_status=lambda **parts: self.states.append(parts["state"]),
            begin_run=lambda *_: None,
        )

    def attach(self, env: Any) -> None:
        self.attached.append(env)

    def finish(self, text: str) -> None:
        self.said = text

    def __exit__(self, *_: object) -> None:
        """Nothing was opened."""


class Stage:
    """A training that ends as told, and what it was shown on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        self.path = tmp_path
        self.is_interrupted = False
        self.error: BaseException | None = None
        self.page: Live | None = None
        self.asked: dict[str, Any] = {}
        self.given: dict[str, Any] = {}
        self.callback: Any = None
        self.reports: list[Any] = []
        monkeypatch.setattr(commands, "run_on_page", self.serve)
        monkeypatch.setattr(commands, "_report", lambda *given, **named: self.reports.append(named))

    @contextmanager
    def serve(self, *given: Any, **named: Any) -> Iterator[Live | None]:
        self.asked = {"given": given, **named}
        yield self.page

    def run(self, callback: Any, **given: Any) -> RunResult:
        self.callback = callback
        self.given = given
        if self.error is not None:
            raise self.error
        return RunResult(self.path, (), self.is_interrupted)


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Stage:
    return Stage(monkeypatch, tmp_path)


def test_training_without_a_page_is_reported(stage: Stage) -> None:
    run_training(stage.run, TrainConfig("WalkerSim-v0"), None, keys=False, film=False)
    assert stage.reports == [{"film": False}]
    assert isinstance(stage.callback, progresses.RunProgress)
    assert stage.given["driver"] is None and not stage.given["stop"].is_set()
    stage.asked["on_stop"]()
    assert stage.given["stop"].is_set(), "what ends it on the page ends the run"


@pytest.mark.parametrize("driver", [None, "a human"])
def test_who_sits_at_the_page_drives_unless_somebody_else_does(
    stage: Stage, driver: str | None
) -> None:
    stage.page = Live()
    given: Any = driver
    run_training(stage.run, TrainConfig("WalkerSim-v0"), PageOptions(), driver=given, keys=False)
    assert stage.given["driver"] == (driver or "who sits at the page")
    assert isinstance(stage.callback, CallbackList)
    assert stage.asked["can_drive"] is (driver is None)


@pytest.mark.parametrize(
    ("config", "named", "can_drive"),
    [
        (TrainConfig("WalkerSim-v0"), {}, True),
        (TrainConfig("WalkerSim-v0", num_envs=2), {}, False),
        (TrainConfig("Walker-v0", robots=2), {}, False),
        (TrainConfig("Walker-v0", hub="ble:A,ble:B"), {}, False),
        (TrainConfig("WalkerSim-v0"), {"can_drive": False}, False),
    ],
)
def test_one_robot_alone_can_be_driven(
    stage: Stage, config: TrainConfig, named: dict[str, Any], can_drive: bool
) -> None:
    run_training(stage.run, config, None, keys=False, **named)
    assert stage.asked["can_drive"] is can_drive
    assert stage.asked["given"][1:] == (config.env, config.robot)


@pytest.mark.parametrize(
    ("is_interrupted", "error"),
    [(True, None), (False, KeyboardInterrupt()), (False, StoppedError("stopped by hand"))],
)
def test_interrupted_training_is_not_reported(
    stage: Stage, is_interrupted: bool, error: BaseException | None
) -> None:
    stage.is_interrupted = is_interrupted
    stage.error = error
    with pytest.raises(Interrupted, match="no episode was finished, so nothing was saved"):
        run_training(stage.run, TrainConfig("WalkerSim-v0"), None, keys=False)
    assert stage.reports == []


@pytest.mark.parametrize("has_screen", [False, True])
@pytest.mark.parametrize(
    ("film", "can_film", "work"),
    [
        (True, True, "filming before and after, and writing the report"),
        (True, False, "writing the report"),
        (False, True, "writing the report"),
    ],
)
def test_end_of_a_training_is_told_line_by_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    film: bool,
    can_film: bool,
    work: str,
    has_screen: bool,
) -> None:
    done: list[Any] = []
    opened: list[str] = []
    saved: list[bool] = []
    evaluation = SimpleNamespace(save=lambda: saved.append(True))

    def evaluate(path: Path, **named: Any) -> Any:
        done.append((path, named["episodes"], named["save"]))
        named["on_env"]("the env")
        return evaluation

    def write_report(*given: Any, film: bool) -> tuple[Path, str]:
        assert given == (tmp_path, result.episodes, evaluation)
        done.append(film)
        return tmp_path / "report.html", "none: it is dark"

    monkeypatch.setattr("bricksrl.evaluation.evaluator.evaluate", evaluate)
    monkeypatch.setattr("bricksrl.evaluation.report.can_film", lambda path: can_film)
    monkeypatch.setattr("bricksrl.evaluation.report.write_report", write_report)
    monkeypatch.setattr(commands, "describe", lambda found: ["return   1"])
    monkeypatch.setattr(commands, "has_screen", lambda: has_screen)
    monkeypatch.setattr(commands.webbrowser, "open", opened.append)
    stop: Any = SimpleNamespace(attach=done.append, quiet=nullcontext)
    page: Any = Live()
    last = Episode(2, Phase.TRAIN, 41, 20, 1.0, None, seconds=2.6)
    result = RunResult(tmp_path, (last,), False, updates_per_step=1.2345, caught_up=7)
    commands._report(result, stop, page, film=film)
    assert done == [(tmp_path, 5, False), "the env", film]
    assert saved == [True]
    assert page.states == ["evaluating"] and page.attached == ["the env"]
    assert page.said == (
        f"Done. `bricksrl play {quoted(tmp_path)} --page` shows what it has learned."
    )
    assert opened == ([(tmp_path / "report.html").as_uri()] if has_screen else [])
    assert capsys.readouterr().out.splitlines() == [
        "trained 2 episodes, 41 steps, in 3 s",
        "learning made 1.23 updates a step while the robot was at work, 7 after it",
        "evaluating",
        "return   1",
        work,
        f"learning curve  {tmp_path / 'learning_curve.png'}",
        "video           none: it is dark",
        f"report          {tmp_path / 'report.html'}",
        f"more episodes   bricksrl evaluate {quoted(tmp_path)} --episodes 20",
    ]


class Bars:
    """A bar on a terminal, of which only what it was told is kept."""

    def __init__(self, *_: Any, **__: Any) -> None:
        self.fields: dict[str, Any] = {}
        self.events: list[str] = []
        self.printed: list[str] = []
        self.console = SimpleNamespace(print=lambda line, **_: self.printed.append(line))

    def add_task(self, _name: str, **fields: Any) -> int:
        self.fields = fields
        return 0

    def update(self, _task: int, **fields: Any) -> None:
        self.fields |= fields

    def start(self) -> None:
        self.events.append("start")

    def stop(self) -> None:
        self.events.append("stop")


def test_bar_on_a_terminal_shows_the_last_thirty_returns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progresses, "Bars", Bars)
    monkeypatch.setattr(progresses.sys.stdout, "isatty", lambda: True, raising=False)
    progress = progresses.RunProgress()
    bar: Any = progress._bar
    assert bar.fields == {"total": None, "value": "-", "spark": "", "rate": ""}
    with progress.hidden():
        assert bar.events == ["stop"]
    assert bar.events == ["stop"], "there is no run to show yet"
    config = TrainConfig("WalkerSim-v0", episodes=40)
    progress.on_start(config, tmp_path, 3)
    assert bar.events == ["stop", "start"]
    assert (bar.fields["total"], bar.fields["completed"]) == (40, 3)
    at = Progress(40, 2.0, 61.0)
    for number in range(32):
        # Of 32 returns the first two are the lowest, and no longer seen.
        value = -1000.0 if number < 2 else float(number)
        progress.on_episode(Episode(number + 1, Phase.TRAIN, 10, 10, value, None), at)
    assert bar.fields["completed"] == 32
    assert bar.fields["value"] == "31"
    assert len(bar.fields["spark"]) == 30
    assert bar.fields["spark"][0] == "▁" and bar.fields["spark"][-1] == "█"
    assert bar.fields["rate"] == "2 steps/s  1:01 left"
    progress.on_note("mind the step")
    assert bar.printed == ["mind the step"]
    with progress.hidden():
        assert bar.events[-1] == "stop"
    assert bar.events[-1] == "start"
    progress.on_end(RunResult(tmp_path, (), False))
    assert bar.events[-1] == "stop"
    captured = capsys.readouterr()
    assert captured.out == f"sac on WalkerSim-v0, seed 0: {tmp_path}\n" and captured.err == ""


def test_several_seeds_are_summed_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = TrainConfig("WalkerSim-v0", seed=4, episodes=9, run_dir=tmp_path / "all")
    asked: list[Any] = []

    def train_all(*given: Any, on: Any, on_line: Any) -> None:
        asked.append((*given, on))
        on_line(6, {"episode": 2, "return": 1.5})

    monkeypatch.setattr(progresses.multi_seed, "train_seeds", train_all)
    monkeypatch.setattr(progresses, "compare", lambda path: path)
    monkeypatch.setattr(progresses, "print_comparison", lambda path: print_line(f"of {path}"))
    progresses.train_seeds(config, 3, "ray")
    assert asked == [(config, 3, "ray")]
    folder = tmp_path / "all"
    assert capsys.readouterr().out.splitlines() == [
        "seed 6  episode 2/9  return 1.5",
        f"of {folder}",
        f"summary          {folder}/summary.json",
        f"learning curves  {folder}/learning_curves.png",
    ]
    with pytest.raises(RunError, match="seeds is 1; give 2 to 1000"):
        progresses.train_seeds(config, 1)


@pytest.mark.parametrize("exists", [False, True])
def test_interrupted_seeds_say_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(progresses.multi_seed, "train_seeds", interrupt)
    folder = tmp_path / "my seeds"
    if exists:
        folder.mkdir()
    message = "no seed had started, so nothing was saved"
    if exists:
        message = (
            f"what was trained is in {folder}; `bricksrl resume {quoted(folder)}/seed-...` resumes "
            "a seed"
        )
    with pytest.raises(Interrupted) as raised:
        progresses.train_seeds(TrainConfig("WalkerSim-v0", run_dir=folder), 2)
    assert str(raised.value) == message
