"""Films and the report at the end of a run, and the film of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from brickhub.files import check_writable
from bricksrl.errors import RenderingUnavailableError, TwinError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.connection import Connection
    from bricksrl.evaluation import EvaluationResult
    from bricksrl.evaluation.report import Films
    from bricksrl.training import RunResult

FILM_BUDGET_S = 20.0
"""Approximate drawing time of each film of a run."""
_FRAME_MS = 80


def film_before_and_after(run_dir: Path, env: str) -> Films:
    """Film an episode of a run's agent before training and one after, and join them side by side. Raises
    RenderingUnavailableError if no OpenGL library works here, TwinError if the environment has no virtual robot."""
    from bricksrl.evaluation.film import FilmOptions, film_run, side_by_side
    from bricksrl.evaluation.report import Films

    before, after = (
        film_run(run_dir, which, run_dir / f"{name}.mp4", FilmOptions(f"{env} {name} learning", budget_s=FILM_BUDGET_S))
        for which, name in (("first", "before"), ("last", "after"))
    )
    both = side_by_side(before.path, after.path, run_dir / "before_after.mp4")
    return Films(before, after, both)


def report(result: RunResult, evaluation: EvaluationResult) -> tuple[Path, str]:
    """Film a run and write its report; returns the report's path, and the film's path or the reason why there is none."""
    from bricksrl.evaluation.report import write_report

    try:
        films, reason = film_before_and_after(result.run_dir, evaluation.env), ""
    except (RenderingUnavailableError, TwinError) as error:
        films, reason = None, str(error)
    path = write_report(result.run_dir, result.episodes, evaluation, films, reason)
    return path, str(films.both) if films is not None else f"none: {reason}"


def check_film(path: Path) -> None:
    """Raise TwinError unless the name ends in .mp4, WriteError if the file cannot be written."""
    if path.suffix.lower() != ".mp4":
        raise TwinError(f"'{path}' is not a name of a film; end it in .mp4")
    check_writable(path)


@contextmanager
def filmed_env(env: EnvBase, path: Path | None, title: str) -> Iterator[None]:
    """Film the virtual robot of an environment inside this context, however it ends; without a path do nothing. Raises TwinError
    if there is no virtual robot to film, or the file is no mp4, RenderingUnavailableError if no OpenGL library works here."""
    if path is None:
        yield
        return
    from bricksrl.envs.env_interface import interface_of
    from bricksrl.evaluation.film import check_filmable
    from bricktwin.twin.mujoco_body import MujocoBody
    from bricktwin.twin.render.opengl import Image, Renderer, VideoWriter
    from bricktwin.twin.render.video import Filmed, Room, captioned

    check_film(path)
    check_filmable(env)
    size, number = (1280, 720), 0
    video, renderers = VideoWriter(path, 1000 / _FRAME_MS), ExitStack()

    def install(connection: Connection) -> None:
        nonlocal number
        body = None if connection.twin is None else connection.twin.body
        if connection.twin is None or not isinstance(body, MujocoBody):
            raise TwinError(f"{env.task.id} has no virtual robot to film; leave out --video")
        renderers.close()  # that of the previous episode
        number, machine, room = number + 1, connection.twin.machine, Room(body)
        renderer = renderers.enter_context(Renderer(body, *size, room.camera, smooth=False, decorate=room.decorate))

        def render() -> Image:
            room.follow()
            caption = f"episode {number}   {machine.time_ms / 1000:.1f} s"
            return captioned(renderer.render(), title, caption, room.metre_marks(*size))

        machine.body = Filmed(machine.body, render, _FRAME_MS, machine.time_ms, video.add)

    with closing(video), renderers, ExitStack() as watch:
        watch.callback(interface_of(env).watch(install))
        yield
