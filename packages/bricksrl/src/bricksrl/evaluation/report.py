"""Report of a run: one HTML file with results, learning curve and films."""

import base64
import contextlib
import html
import io
import itertools
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from brickhub.files import quoted, write_durably
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.envs.registry import get_task, is_simulation
from bricksrl.errors import (
    BricksError,
    RenderingUnavailableError,
    TwinError,
    WriteError,
    counted,
    percent,
)
from bricksrl.evaluation.evaluator import EvaluationResult
from bricksrl.evaluation.film import Film, check_run_filmable, film_run, side_by_side
from bricksrl.training.callbacks import Episode
from bricksrl.training.run_folder import Origin, RunFolder
from bricktwin.report_page import plain_number, report_page

FILM_BUDGET_S = 10.0
"""Approximate drawing time of each film of a run."""
MOST_EMBEDDED_BYTES = 12_000_000
"""Size above which a film is linked rather than embedded."""
_CURVE = (
    "Each dot is an episode of training, in which the agent also tries what it does not "
    "know yet; the line is their mean."
)
_REFERENCES = (
    " The dashed lines are what random actions get, a controller that was written by somebody "
    "who knows the robot "
    "(<code>benchmarks/baselines.py</code>), and, where the paper has the environment, its SAC."
)


class Films(NamedTuple):
    """Films of a run: before training, after it, and both side by side."""

    before: Film
    after: Film
    both: Path


def film_before_and_after(run_dir: Path, env: str) -> Films:
    """Film an episode of a run's agent before training and one after, and join them side by side.
    Raises RenderingUnavailableError if no OpenGL library works here, TwinError if the environment
    has no virtual robot."""

    def film(which: str, name: str) -> Film:
        path = run_dir / f"{name}.mp4"
        title = f"{env} {name} learning"
        return film_run(
            run_dir,
            which,
            path,
            title,
            budget_s=FILM_BUDGET_S,
        )

    before = film("first", "before")
    after = film("last", "after")
    both = side_by_side(before.path, after.path, run_dir / "before_after.mp4")
    return Films(before, after, both)


def can_film(run_dir: Path) -> bool:
    """Whether a film of a run can be made here; the report says why not."""
    try:
        check_run_filmable(run_dir)
    except (RenderingUnavailableError, TwinError):
        return False
    return True


def write_report(
    run_dir: Path,
    episodes: Sequence[Episode],
    result: EvaluationResult,
    *,
    film: bool = True,
) -> tuple[Path, str]:
    """Film a run, unless ``film`` is False, and write ``report.html`` into its folder.

    Args:
        episodes: episodes of the training.
        result: evaluation after the training.

    Returns:
        Path of the report, and of the film, or the reason why there is none.
    """
    films = None
    reason = "it was left out (--no-film)"
    try:
        films = film_before_and_after(run_dir, result.env) if film else None
    except (RenderingUnavailableError, TwinError, WriteError) as error:
        # A disk that is full for a film may have room for the report.
        reason = str(error)
    folder = RunFolder(run_dir)
    origin = folder.origin()
    name = folder.trained_by()
    # No format code that all systems have gives a day without a leading zero.
    date = f"{datetime.now().astimezone():%d %B %Y}".lstrip("0")
    body = [
        f"<h1>{html.escape(result.env)}: what the robot has learned</h1>",
        f"<p class=who>{html.escape(f'{name} · {date}' if name else date)}</p>",
        *_about(origin),
        f"<p class=lead>{_lead(episodes, result, films)}</p>",
        *_film_part(films, reason),
        *_picture(films),
        "<h2>Return, episode by episode</h2>",
        f'<img src="{_data_url(folder.curve_path, "image/png")}" alt="learning curve">',
        f"<p>{_CURVE}{_REFERENCES if result.env in REFERENCES else ''}</p>",
        "<h2>Evaluation</h2>",
        _table((html.escape(label), html.escape(value)) for label, value in rows(result)),
        "<section class=screen><h2>Go on</h2>",
        _commands(run_dir, origin, result.trained_episodes),
        "</section>",
    ]
    path = run_dir / "report.html"
    text = report_page(f"{result.env}: report", "\n".join(body))
    # Names are written as the system has them, because a folder's name may be no valid text in this
    # computer's locale.
    write_durably(path, text.encode(errors="surrogateescape"))
    return path, str(films.both) if films is not None else f"none: {reason}"


def _about(origin: Origin) -> Iterable[str]:
    """What the robot was to learn, in the words of its task; nothing for an environment that was
    given to `train`, and has no name to look it up by."""
    with contextlib.suppress(BricksError):
        yield f"<p>{html.escape(get_task(origin.env, **origin.options.options).summary)}</p>"


def _lead(
    episodes: Sequence[Episode],
    result: EvaluationResult,
    films: Films | None,
) -> str:
    last = episodes[-1]
    learned = counted(episodes[-1].episode, "episode")
    played = counted(result.episodes, "episode")
    text = (
        f"The agent <b>{html.escape(result.agent)}</b> learned for {learned} "
        f"({counted(last.steps, 'step')} of the robot) in "
        f"{last.seconds:.0f} s. Then it did its best in {played}: a mean return of "
        f"<b>{plain_number(result.return_mean)}</b>"
    )
    reference = REFERENCES.get(result.env)
    if reference is not None:
        by_hand = f"a controller written by hand {plain_number(reference['by hand'])}"
        text += f", where random actions get {plain_number(reference['random'])} and {by_hand}"
    walked = result.metrics.get("forward_m")
    if walked is not None:
        text += f". It moved <b>{walked:.2f} m</b> in an episode"
        text += "" if films is None else f"; before it had learned, {films.before.forward_m:.2f} m"
    return text + "."


def _film_part(films: Films | None, no_films: str) -> Iterable[str]:
    yield "<section class=screen><h2>Before and after</h2>"
    yield from _film(films, no_films)
    yield "</section>"


def _picture(films: Films | None) -> Iterable[str]:
    """Picture from the middle of the film after learning, for a print, which has no films."""
    if films is None:
        return
    import imageio_ffmpeg
    from PIL import Image

    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(films.after.path))
    reader = imageio_ffmpeg.read_frames(str(films.after.path))
    size = next(reader)["size"]
    picture = next(itertools.islice(reader, frames // 2, None), None)
    reader.close()
    if picture is None:
        return
    data = io.BytesIO()
    Image.frombytes("RGB", size, picture).save(data, "JPEG", quality=85)
    text = base64.b64encode(data.getvalue()).decode()
    yield f'<img class=print src="data:image/jpeg;base64,{text}" alt="the robot after learning">'


def _film(films: Films | None, no_films: str) -> Iterable[str]:
    if films is None:
        yield f"<p>There is no film: {html.escape(no_films)}</p>"
        return
    # A page that can be mailed contains its film, but a large film would keep browsers from opening
    # it.
    is_small = films.both.stat().st_size <= MOST_EMBEDDED_BYTES
    source = _data_url(films.both, "video/mp4") if is_small else html.escape(films.both.name)
    # No browser starts a film by itself unless it is muted.
    yield f'<video src="{source}" controls autoplay loop muted playsinline></video>'
    names = [path.name for path in (films.before.path, films.after.path, films.both)]
    links = ", ".join(f'<a href="{name}">{name}</a>' for name in names)
    before = plain_number(films.before.return_)
    after = plain_number(films.after.return_)
    yield (
        f"<p>Left before learning (return {before}), right after it (return {after}). The "
        f"files: {links}.</p>"
    )


_UNITS = {
    "_m_s": "m/s",
    "_deg_s": "deg/s",
    "_mm": "mm",
    "_m": "m",
    "_deg": "deg",
    "_pct": "%",
    "_px": "px",
}
"""Units of metrics by ending of the name, longest endings first."""


def rows(result: EvaluationResult) -> Iterable[tuple[str, str]]:
    """Labels and texts of an evaluation, with its 95 % intervals."""
    text = f"{plain_number(result.return_mean)} ± {plain_number(result.return_std)}"
    interval = result.return_interval
    if interval is not None:
        low = plain_number(interval.low)
        high = plain_number(interval.high)
        text += f" (95 % interval of the mean: {low} to {high})"
    yield "return", text
    if result.success_rate is not None:
        successes = round(result.success_rate * result.episodes)
        text = f"{successes} of {counted(result.episodes, 'episode')}"
        rate = result.success_interval
        if rate is not None:
            text += f" (95 % interval of the rate: {percent(rate.low)} to {percent(rate.high)})"
        yield "success", text
    for name, value in result.metrics.items():
        yield labelled(name, value)


def labelled(name: str, value: float) -> tuple[str, str]:
    """Label and value of a metric, with its unit: "forward speed" and "0.05246 m/s" for
    ``forward_speed_m_s``."""
    text = plain_number(value)
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            name = name.removesuffix(ending)
            text = f"{text} {unit}"
            break
    return name.replace("_", " "), text


def _table(rows: Iterable[tuple[str, str]]) -> str:
    """Table of labels and values, which are HTML."""
    lines = [f"<tr><th>{label}</th><td>{value}</td></tr>" for label, value in rows]
    return f"<table>{''.join(lines)}</table>"


def _commands(
    run_dir: Path,
    origin: Origin,
    trained_episodes: int,
) -> str:
    run = quoted(run_dir)
    env = quoted(origin.env)
    # The advice for a run that has learned from data alone is to go on with a robot.
    if origin.is_offline:
        longer = f"bricksrl train {env} --demonstrations {run}"
    else:
        longer = f"bricksrl resume {run} --episodes {2 * trained_episodes} --page"
    commands = {
        "watch it, and compare it with how it began": f"bricksrl play {run} --page",
        "let it learn for longer": longer,
        "count more episodes": f"bricksrl evaluate {run} --episodes 20",
    }
    if not is_simulation(origin.env):
        commands["on a LEGO robot"] = f"bricksrl evaluate {run} --hub ble"
    export = f"bricksrl export {run} --out policy.pt2"
    commands["use the policy in a program of your own"] = export
    shown = {label: html.escape(text, quote=False) for label, text in commands.items()}
    return _table((label, f"<code>{text}</code>") for label, text in shown.items())


def _data_url(path: Path, mime_type: str) -> str:
    return f"data:{mime_type};base64,{base64.b64encode(path.read_bytes()).decode()}"
