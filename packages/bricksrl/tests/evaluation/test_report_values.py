"""What the report of a run says, to the letter, without training or filming."""

from __future__ import annotations

import html
import io
import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Never

import numpy as np
import pytest
from PIL import Image
from test_comparison import write_run

from bricksrl.envs import get_task
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.rollout import EpisodeScore
from bricksrl.errors import RenderingUnavailableError, TwinError
from bricksrl.evaluation import report
from bricksrl.evaluation.evaluator import EvaluationResult, evaluation_options
from bricksrl.evaluation.film import Film, side_by_side
from bricksrl.evaluation.report import Films, can_film, film_before_and_after, rows, write_report
from bricksrl.evaluation.statistics import Interval, wilson_interval
from bricksrl.training import Episode, Phase, TrainConfig
from bricksrl.training.run_folder import Origin, RunFolder
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import VideoWriter


def result_of(env: str, *scores: EpisodeScore) -> EvaluationResult:
    return EvaluationResult.of(
        scores,
        run_dir="run",
        env=env,
        agent="sac",
        hub="virtual",
        seed=1000,
        trained_episodes=20,
        as_trained=True,
    )


ONE = EpisodeScore(19.5, 20, 0.5, None, {})
LAST = Episode(20, Phase.TRAIN, 400, 20, 5.0, None, seconds=62.4)


def films_in(folder: Path, size: int = 3) -> Films:
    """Films before (return -1.25, 0.1 m) and after (return 20, 1.5 m), as files of a few bytes."""
    both = folder / "before_after.mp4"
    both.write_bytes(b"x" * size)
    before = Film(folder / "before.mp4", -1.25, 0.1)
    after = Film(folder / "after.mp4", 20.0, 1.5)
    return Films(before, after, both)


def test_result_is_of_all_episodes() -> None:
    """Returns 1, 2, 3 and 6: their mean is 3, their variance 3.5, the mean of the inner two 2.5."""
    scores = [
        EpisodeScore(1.0, 10, 0.1, True, {"forward_m": 1.0, "turned_deg": -4.0}),
        EpisodeScore(2.0, 20, 0.2, False, {"forward_m": 2.0, "turned_deg": 8.0}),
        EpisodeScore(3.0, 30, 0.3, None, {"forward_m": 3.0, "turned_deg": 0.0}),
        EpisodeScore(6.0, 40, 0.8, False, {"forward_m": 4.0, "turned_deg": 0.0}),
    ]
    result = result_of("Own-v0", *scores)
    assert result.episodes == 4
    assert result.return_mean == 3.0
    assert result.return_std == pytest.approx(3.5**0.5)
    assert result.return_iqm == 2.5
    assert result.return_interval is None
    assert (result.returns, result.lengths) == ((1.0, 2.0, 3.0, 6.0), (10, 20, 30, 40))
    assert result.action_size == pytest.approx(0.35)
    assert result.success_rate == pytest.approx(1 / 3), "of three that were judged"
    assert result.success_interval == wilson_interval(1, 3)
    assert result.metrics == {"forward_m": 2.5, "turned_deg": 1.0}


def test_interval_of_returns_is_of_their_mean() -> None:
    """Of one outlier in five the interquartile mean would know little."""
    scores = [replace(ONE, return_=value) for value in (0.0, 0.0, 0.0, 0.0, 100.0)]
    result = result_of("Own-v0", *scores)
    assert result.return_interval == Interval(0.0, 60.0)
    assert list(rows(result)) == [
        ("return", "20 ± 40 (95 % interval of the mean: 0 to 60)"),
    ]


def test_rates_and_metrics_without_intervals() -> None:
    result = replace(result_of("Own-v0", replace(ONE, success=True)), success_interval=None)
    metrics = {"forward_m": 1.5, "share_pct": 40.0, "height_mm": 7.0}
    assert list(rows(replace(result, metrics=metrics))) == [
        ("return", "19.5 ± 0"),
        ("success", "1 of 1 episode"),
        ("forward", "1.5 m"),
        ("share", "40 %"),
        ("height", "7 mm"),
    ]


def test_lead_compares_with_what_is_known(tmp_path: Path) -> None:
    assert report._lead([LAST], result_of("RunAway-v0", ONE, ONE), None) == (
        "The agent <b>sac</b> learned for 20 episodes (400 steps of the robot) in 62 s. Then it "
        "did its best in 2 episodes: a mean return of <b>19.5</b>, where random actions get 0.38 "
        "and a controller written by hand 18.02."
    )
    short = Episode(1, Phase.TRAIN, 1, 1, 5.0, None, seconds=0.6)
    walked = replace(result_of("Own-v0", ONE), metrics={"forward_m": 1.456}, agent="<own>")
    text = (
        "The agent <b>&lt;own&gt;</b> learned for 1 episode (1 step of the robot) in 1 s. Then it "
        "did its best in 1 episode: a mean return of <b>19.5</b>. It moved <b>1.46 m</b> in an "
        "episode"
    )
    assert report._lead([LAST, short], walked, None) == f"{text}."
    films = films_in(tmp_path)
    assert report._lead([LAST, short], walked, films) == (f"{text}; before it had learned, 0.10 m.")


@pytest.mark.parametrize("limit", [2, 3])
def test_large_film_is_linked_instead_of_embedded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    monkeypatch.setattr(report, "MOST_EMBEDDED_BYTES", limit)
    source = "data:video/mp4;base64,eHh4" if limit == 3 else "before_after.mp4"
    assert list(report._film_part(films_in(tmp_path), "")) == [
        "<section class=screen><h2>Before and after</h2>",
        f'<video src="{source}" controls autoplay loop muted playsinline></video>',
        (
            "<p>Left before learning (return -1.25), right after it (return 20). The files: "
            '<a href="before.mp4">before.mp4</a>, <a href="after.mp4">after.mp4</a>, '
            '<a href="before_after.mp4">before_after.mp4</a>.</p>'
        ),
        "</section>",
    ]


def test_missing_film_has_its_reason() -> None:
    assert list(report._film_part(None, "a < b")) == [
        "<section class=screen><h2>Before and after</h2>",
        "<p>There is no film: a &lt; b</p>",
        "</section>",
    ]
    assert list(report._picture(None)) == []


def test_print_shows_the_middle_of_the_film_after_learning(tmp_path: Path) -> None:
    """Of five images from black to white the third is grey."""
    films = films_in(tmp_path)
    with VideoWriter(films.after.path, 10) as video:
        for brightness in (0, 60, 120, 180, 240):
            video.add(np.full((240, 320, 3), brightness, np.uint8))
    (line,) = report._picture(films)
    found = re.fullmatch(
        r'<img class=print src="data:image/jpeg;base64,(.*)" alt="the robot after learning">', line
    )
    assert found is not None
    picture = Image.open(io.BytesIO(report.base64.b64decode(found[1])))
    assert (picture.format, picture.size) == ("JPEG", (320, 240))
    assert np.asarray(picture).mean() == pytest.approx(120, abs=10)


def test_films_are_of_the_first_and_the_last_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[Any, ...]] = []

    def film_run(
        run_dir: Path,
        which: str,
        path: Path,
        title: str,
        budget_s: float,
    ) -> Film:
        made.append((run_dir, which, path.name, title, budget_s))
        return Film(path, 1.0, 0.0)

    monkeypatch.setattr(report, "film_run", film_run)
    monkeypatch.setattr(report, "side_by_side", lambda *films: films)
    films = film_before_and_after(tmp_path, "Walker-v0")
    assert made == [
        (tmp_path, "first", "before.mp4", "Walker-v0 before learning", report.FILM_BUDGET_S),
        (tmp_path, "last", "after.mp4", "Walker-v0 after learning", report.FILM_BUDGET_S),
    ]
    names = ("before.mp4", "after.mp4", "before_after.mp4")
    assert films.both == tuple(tmp_path / name for name in names)
    assert (films.before.path, films.after.path) == films.both[:2]


@pytest.mark.parametrize("error", [RenderingUnavailableError, TwinError, None])
def test_run_can_be_filmed_where_nothing_is_against_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[Exception] | None
) -> None:
    def check(run_dir: Path) -> None:
        assert run_dir == tmp_path
        if error is not None:
            raise error("no")

    monkeypatch.setattr(report, "check_run_filmable", check)
    assert can_film(tmp_path) is (error is None)


def table_of(text: str) -> dict[str, str]:
    """Labels and commands of a table, which is nothing but its rows."""
    cell = r"<tr><th>(.*?)</th><td><code>(.*?)</code></td></tr>"
    assert re.fullmatch(f"<table>({cell})*</table>", text)
    return dict(re.findall(cell, text))


def test_commands_go_on_with_the_run() -> None:
    origin = Origin("RunAway-v0", EnvOptions(), "sac", 0, is_offline=False)
    walk = "bricksrl evaluate my-run"
    usual = {
        "watch it, and compare it with how it began": "bricksrl play my-run --page",
        "let it learn for longer": "bricksrl resume my-run --episodes 40 --page",
        "count more episodes": f"{walk} --episodes 20",
        "on a LEGO robot": f"{walk} --hub ble",
        "use the policy in a program of your own": "bricksrl export my-run --out policy.pt2",
    }
    assert table_of(report._commands(Path("my-run"), origin, 20)) == usual
    simulated = origin._replace(env="WalkerSim-v0", is_offline=True)
    del usual["on a LEGO robot"]
    longer = "bricksrl train WalkerSim-v0 --demonstrations my-run"
    usual["let it learn for longer"] = longer
    assert table_of(report._commands(Path("my-run"), simulated, 20)) == usual


@pytest.mark.parametrize(
    ("env", "name"), [("RunAway-v0", "Anna & Ben"), ("RunAway-v0", ""), ("Park-v0", "")]
)
def test_report_has_its_parts_in_order(tmp_path: Path, env: str, name: str) -> None:
    run = write_run(tmp_path / "run", TrainConfig(env, name=name), [5.0])
    RunFolder(run).curve_path.write_bytes(b"curve")
    before = datetime.now().astimezone()
    path, film = write_report(run, [LAST], result_of(env, ONE), film=False)
    days = {f"{day:%d %B %Y}".lstrip("0") for day in (before, datetime.now().astimezone())}
    assert path == run / "report.html"
    assert film == "none: it was left out (--no-film)"
    text = path.read_text(encoding="utf-8")
    assert f"<title>{env}: report</title>" in text
    body = text[text.index("<h1>") :]
    who = html.escape(f"{name} · ") if name else ""
    assert any(f"<p class=who>{who}{day}</p>" in body for day in days)
    parts = [
        f"<h1>{env}: what the robot has learned</h1>",
        "<p class=who>",
        f"<p>{html.escape(get_task(env).summary)}</p>",
        "<p class=lead>The agent <b>sac</b> learned for 20 episodes",
        "<p>There is no film: it was left out (--no-film)</p>",
        "<h2>Return, episode by episode</h2>",
        '<img src="data:image/png;base64,Y3VydmU=" alt="learning curve">',
        "<p>Each dot is an episode of training",
        "<h2>Evaluation</h2>",
        "<table><tr><th>return</th><td>19.5 ± 0</td></tr></table>",
        "<section class=screen><h2>Go on</h2>",
        "<table><tr><th>watch it",
    ]
    places = [body.index(part) for part in parts]
    assert places == sorted(places)
    assert ("The dashed lines are what random actions get" in body) is (env in report.REFERENCES)


def test_environment_of_nobody_has_no_summary() -> None:
    origin = Origin("Nobodys-v0", EnvOptions(), "sac", 0, is_offline=False)
    assert list(report._about(origin)) == []


def test_films_that_cannot_be_joined_are_named(tmp_path: Path) -> None:
    left = tmp_path / "left.mp4"
    right = tmp_path / "right.mp4"
    with pytest.raises(TwinError) as raised:
        side_by_side(left, right, tmp_path / "both.mp4")
    text = str(raised.value)
    assert text.startswith(f"{left} and {right} cannot be joined (")
    assert text.endswith("); make them again") and "\n" not in text


PHYSICS = Physics(battery_v=7.0)
TRAINED = EnvOptions(
    realtime=True,
    physics=PHYSICS,
    link="mac",
    options={"step_ms": 300},
    frame_stack=2,
)


@pytest.mark.parametrize(
    ("env", "named", "kept"),
    [
        ("WalkerSim-v0", {}, {"physics": PHYSICS, "link": "mac"}),
        ("WalkerSim-v0", {"hub": "virtual"}, {"physics": PHYSICS, "link": "mac"}),
        ("WalkerSim-v0", {"hub": "ble"}, {"hub": "ble"}),
        ("WalkerSim-v0", {"randomize": True}, {"randomize": True, "link": "mac"}),
        ("WalkerSim-v0", {"realtime": True}, {"realtime": True, "physics": PHYSICS, "link": "mac"}),
        ("WalkerSim-v1", {}, {}),
        ("WalkerSim-v1", {"link": "usb"}, {"link": "usb"}),
        ("Spinning-v0", {}, {"options": {}}),
    ],
)
def test_evaluation_keeps_the_world_of_its_training(
    env: str, named: dict[str, Any], kept: dict[str, Any]
) -> None:
    origin = Origin("WalkerSim-v0", TRAINED, "sac", 0, is_offline=False)
    usual = {"options": {"step_ms": 300}, "frame_stack": 2}
    assert evaluation_options(origin, env, **named) == EnvOptions(**(usual | kept))


def test_real_robot_has_no_twin_to_keep() -> None:
    origin = Origin("Walker-v0", EnvOptions(hub="ble"), "sac", 0, is_offline=False)
    assert evaluation_options(origin, "Walker-v0") == EnvOptions(hub="ble")
    assert evaluation_options(origin, "Walker-v0", hub="virtual") == EnvOptions()


def test_disk_that_is_full_for_the_result_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> Never:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bricksrl.evaluation.evaluator.write_durably", full)
    result = replace(result_of("Own-v0", ONE), run_dir=str(tmp_path))
    with pytest.raises(report.BricksError) as raised:
        result.save()
    assert str(raised.value) == (
        f"the evaluation is not saved: cannot write {tmp_path / 'evaluation.json'} (No space left "
        "on device); make room or copy it"
    )


def test_report_with_films_names_the_one_of_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = write_run(tmp_path / "run", TrainConfig("RunAway-v0"), [5.0])
    RunFolder(run).curve_path.write_bytes(b"curve")
    films = films_in(run)
    asked: list[Any] = []

    def film(*given: Any) -> Films:
        asked.append(given)
        return films

    monkeypatch.setattr(report, "film_before_and_after", film)
    monkeypatch.setattr(report, "_picture", lambda given: ["<img class=print>"] if given else [])
    result = replace(result_of("RunAway-v0", ONE), metrics={"forward_m": 1.5})
    path, said = write_report(run, [LAST], result)
    assert asked == [(run, "RunAway-v0")] and said == str(films.both)
    text = path.read_text(encoding="utf-8")
    assert "It moved <b>1.50 m</b> in an episode; before it had learned, 0.10 m." in text
    assert "data:video/mp4;base64,eHh4" in text and "There is no film" not in text
    assert text.index("<video ") < text.index("<img class=print>") < text.index("<h2>Return, ")
