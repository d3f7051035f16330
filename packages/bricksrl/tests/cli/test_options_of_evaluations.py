"""What the commands for trained agents make of their options, and the lines that they print."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from test_options_of_trainings import write_run

from brickhub.cli.terminal import Interrupted
from bricksrl.cli import evaluate as commands
from bricksrl.cli.evaluate import Compare, Evaluate, Export, Plot, Trust, describe
from bricksrl.envs.rollout import EpisodeScore
from bricksrl.errors import DescriptionError, RunError, StoppedError, TwinError
from bricksrl.evaluation.evaluator import EvaluationResult
from bricksrl.training import TrainConfig
from bricktwin.twin.physics import Physics, write_physics

RESULT = EvaluationResult.of(
    [EpisodeScore(2.5, 20, 0.5, None, {"forward_m": 1.25})],
    run_dir="run",
    env="Walker-v0",
    agent="sac",
    hub="virtual",
    seed=1000,
    trained_episodes=1,
    as_trained=True,
)


class Evaluations:
    """Evaluations that were asked for, of some episodes, and what was filmed of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Any] = []
        self.filmed: list[Any] = []
        self.shown = 0
        self.is_filming = False
        self.error: BaseException | None = None
        self.saved: list[EvaluationResult] = []
        monkeypatch.setattr(commands, "load_learning", lambda: None)
        monkeypatch.setattr("bricksrl.evaluation.evaluator.evaluate", self.evaluate)
        monkeypatch.setattr("bricksrl.evaluation.film.filmed_env", self.film)

        def save(result: EvaluationResult) -> None:
            self.saved.append(result)

        monkeypatch.setattr(EvaluationResult, "save", save)

    @contextmanager
    def film(self, env: Any, path: Path | None, title: str) -> Iterator[None]:
        self.filmed.append((path, title))
        self.is_filming = path is not None
        yield
        self.is_filming = False

    def evaluate(self, run: Path, env: Any, **named: Any) -> EvaluationResult:
        on_episode = named.pop("on_episode")
        on_env = named.pop("on_env")
        del named["place"]
        self.asked.append((run, env, named))
        if self.error is not None:
            raise self.error
        on_env(SimpleNamespace(task=SimpleNamespace(id="Walker-v0"), robots=1))
        for episode in range(1, named["episodes"] + 1):
            self.shown += self.is_filming
            on_episode(episode, episode + 0.12345)
        return RESULT


@pytest.fixture
def evaluations(monkeypatch: pytest.MonkeyPatch) -> Evaluations:
    stop = SimpleNamespace(attach=lambda env: None, quiet=nullcontext)
    monkeypatch.setattr(commands, "EmergencyStop", lambda *_: nullcontext(stop))
    return Evaluations(monkeypatch)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path / "run", TrainConfig("Walker-v0"))


USUAL = {
    "episodes": 5,
    "seed": 1000,
    "which": "last",
    "save": False,
    "realtime": False,
    "randomize": False,
}


@pytest.mark.parametrize(
    ("options", "changes"),
    [
        ({}, {}),
        ({"episodes": 2, "seed": 7}, {"episodes": 2, "seed": 7}),
        ({"best": True}, {"which": "best"}),
        ({"hub": "ble:Rover", "link": "mac"}, {"hub": "ble:Rover", "link": "mac"}),
        ({"realtime": True, "randomize": True}, {"realtime": True, "randomize": True}),
        ({"fault": ("stall left",)}, {"fault": ("stall left",)}),
    ],
)
def test_evaluation_has_the_options_that_were_given(
    evaluations: Evaluations, run: Path, options: dict[str, Any], changes: dict[str, Any]
) -> None:
    Evaluate(run, **options).execute()
    assert evaluations.asked == [(run, None, USUAL | changes)]
    assert evaluations.saved == [RESULT]


def test_evaluation_is_told_line_by_line(
    evaluations: Evaluations, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Evaluate(run, "WalkerSim-v0", episodes=2).execute()
    assert evaluations.asked[0][1] == "WalkerSim-v0"
    assert capsys.readouterr().out.splitlines() == [
        "episode 1/2  return 1.123",
        "episode 2/2  return 2.123",
        "Walker-v0, 1 episode of sac after 1 episode of training:",
        "return   2.5 ± 0",
        "forward  1.25 m",
    ]
    Evaluate(run, episodes=2, json=True).execute()
    assert capsys.readouterr().out == RESULT.to_json() + "\n"
    several = replace(RESULT, episodes=2, trained_episodes=30)
    assert next(iter(describe(several))) == (
        "Walker-v0, 2 episodes of sac after 30 episodes of training:"
    )


def test_physics_of_a_file_are_read(evaluations: Evaluations, run: Path, tmp_path: Path) -> None:
    physics = Physics(battery_v=7.0)
    write_physics(tmp_path / "physics.json", physics)
    Evaluate(run, physics=tmp_path / "physics.json").execute()
    assert evaluations.asked[0][2] == USUAL | {"physics": physics}


@pytest.mark.parametrize(("episodes", "shown"), [(2, 2), (3, 3), (5, 3)])
def test_three_episodes_are_filmed(
    evaluations: Evaluations,
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    episodes: int,
    shown: int,
) -> None:
    video = tmp_path / "film.mp4"
    Evaluate(run, episodes=episodes, video=video).execute()
    assert evaluations.filmed == [(video, "Walker-v0")]
    assert evaluations.shown == shown
    assert capsys.readouterr().err == f"video    {video}\n"


def test_only_a_virtual_robot_is_filmed(evaluations: Evaluations, tmp_path: Path) -> None:
    real = write_run(tmp_path / "real", TrainConfig("Walker-v0", hub="ble"))
    virtual = write_run(tmp_path / "virtual", TrainConfig("Walker-v0"))
    video = tmp_path / "film.mp4"
    for run, hub in ((real, None), (virtual, "usb")):
        with pytest.raises(TwinError) as raised:
            Evaluate(run, hub=hub, video=video).execute()
        assert str(raised.value) == (
            "only a virtual robot can be filmed; give --hub virtual, or no --video"
        )
    Evaluate(real, hub="virtual", video=video).execute()
    with pytest.raises(TwinError, match="is not a name of a film; end it in"):
        Evaluate(virtual, video=tmp_path / "film.gif").execute()
    assert len(evaluations.asked) == 1


def test_stopped_evaluation_counts_nothing(evaluations: Evaluations, run: Path) -> None:
    evaluations.error = StoppedError("stopped by hand")
    with pytest.raises(Interrupted, match="^nothing was counted$"):
        Evaluate(run).execute()
    assert evaluations.saved == []


@pytest.mark.parametrize("options", [{"runs": (Path("one"),)}, {"out": Path("a.png")}])
def test_class_is_listed_alone(tmp_path: Path, options: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError) as raised:
        Compare(class_folder=tmp_path, **options).execute()
    assert str(raised.value) == (
        "--class lists the runs below its folder, without a picture; omit RUN and --out, or --class"
    )


@pytest.mark.parametrize("json", [False, True])
def test_comparison_draws_what_it_says(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    json: bool,
) -> None:
    drawn: list[Any] = []
    found = SimpleNamespace(to_json=lambda: "{}", groups="the groups")
    monkeypatch.setattr(commands, "compare", lambda runs: found)
    monkeypatch.setattr(commands, "print_comparison", drawn.append)
    monkeypatch.setattr(commands, "draw", lambda *given: drawn.append(given))
    out = tmp_path / "a.png"
    Compare((tmp_path,), out=out, json=json).execute()
    picture = (out, "the groups")
    assert drawn == ([picture] if json else [found, picture])
    assert capsys.readouterr().out == ("{}\n" if json else f"picture  {out}\n")
    Plot((tmp_path,), out).execute()
    assert drawn[-1] == picture
    assert capsys.readouterr().out == f"picture  {out}\n"
    for command in (Compare((tmp_path,), out=Path("a.gif")), Plot((tmp_path,), Path("a.gif"))):
        with pytest.raises(DescriptionError, match=r"^'a.gif' is not a name of a picture; end it"):
            command.execute()


@pytest.mark.parametrize("is_own", [False, True])
def test_program_for_the_hub_is_told_with_what_it_needs(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    is_own: bool,
) -> None:
    asked: list[Any] = []
    made = SimpleNamespace(
        kind="gait",
        program_bytes=1234,
        heap_bytes=567,
        computing_ms=8,
        hub_return=1.234,
        policy_return=5.678,
    )

    def export(*given: Any, **named: Any) -> Any:
        asked.append((*given, named))
        return made

    monkeypatch.setattr(commands, "load_learning", lambda: None)
    monkeypatch.setattr("bricksrl.policies.hub_export.export_program", export)
    monkeypatch.setattr("bricksrl.policies.hub_export.export_own", export)
    out = tmp_path / "walk.py"
    run = Path("Walker-v1") if is_own else Path("runs/walk")
    Export(run, out, "hub", best=True).execute()
    assert asked == [("Walker-v1", out, {}) if is_own else (run, out, {"which": "best"})]
    assert capsys.readouterr().out.splitlines() == [
        "playing and comparing",
        f"written  {out}  (a gait: 1234 bytes, and 567 of objects)",
        "computes for 8 ms a step at most, if a product takes what we infer",
        "return   1.23 on the virtual hub, 5.68 of the policy",
    ]


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (("a.py", "b.py"), "runs/one may run a.py, b.py\n"),
        ((), "runs/one names no code; it needs no trust\n"),
    ],
)
def test_trust_names_what_may_run(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    files: tuple[str, ...],
    says: str,
) -> None:
    monkeypatch.setattr(commands, "trust", lambda run: files)
    Trust(Path("runs/one")).execute()
    assert capsys.readouterr().out.replace("\\", "/") == says


def test_policy_that_is_nowhere_is_refused() -> None:
    with pytest.raises(RunError):
        commands._existing_or_own("runs/nothing")
    commands._existing_or_own("Walker-v1")
