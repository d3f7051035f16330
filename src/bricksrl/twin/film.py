"""Films a virtual robot while a program moves it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bricksrl.errors import TwinError
from bricksrl.twin.machine import Machine
from bricksrl.twin.mujoco_body import MujocoBody
from bricksrl.twin.rendering import Image, Renderer, VideoWriter

SIZE = (480, 360)
_FRAME_MS = 40


class Filmed:
    """Stands in for a body and takes a picture whenever one is due in simulated time."""

    def __init__(self, body: Any, renderer: Renderer, frame_ms: int, time_ms: int, take: Callable[[Image], None]) -> None:
        self._body = body
        self._renderer = renderer
        self._frame_ms = frame_ms
        self._due_ms = time_ms
        self._take = take

    def advance_to(self, time_ms: int) -> None:
        """Let the body move on; then look."""
        self._body.advance_to(time_ms)
        if time_ms >= self._due_ms:
            self._due_ms += self._frame_ms
            self._take(self._renderer.render())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._body, name)


@contextmanager
def filmed(machine: Machine, path: Path) -> Iterator[None]:
    """Film a machine's robot into an mp4 file, as long as this lasts, at the speed of its own time.

    Raises:
        RenderingUnavailableError: no OpenGL library works here.
        TwinError: there is nothing to see of the robot, or the file is no mp4.
    """
    body = machine.body
    if not isinstance(body, MujocoBody):
        raise TwinError(f"there is nothing to see of robot '{machine.robot.name}'; film one with a MuJoCo model")
    if path.suffix.lower() != ".mp4":
        raise TwinError(f"'{path}' is no name of a film; end it in .mp4")
    with Renderer(body, *SIZE) as renderer, VideoWriter(path, 1000 / _FRAME_MS) as video:
        video.add(renderer.render())
        machine.body = Filmed(body, renderer, _FRAME_MS, machine.time_ms + _FRAME_MS, video.add)
        try:
            yield
        finally:
            machine.body = body
