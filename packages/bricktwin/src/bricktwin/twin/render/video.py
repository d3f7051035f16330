"""Video of a virtual robot that a program moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from brickhub.errors import TwinError
from brickhub.virtual.body import Body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.render.opengl import Image, Renderer, VideoWriter

SIZE = (480, 360)
_FRAME_MS = 40


class Filmed:
    """Proxy of a body that takes an image, as ``render`` returns it, every ``frame_ms`` of simulated time."""

    def __init__(
        self, body: Any, render: Callable[[], Image], frame_ms: int, time_ms: int, on_image: Callable[[Image], None]
    ) -> None:
        self._body = body
        self._render = render
        self._frame_ms = frame_ms
        self._due_ms = time_ms
        self._on_image = on_image

    def advance_to(self, time_ms: int) -> None:
        """Advance the body; then take an image if one is due."""
        self._body.advance_to(time_ms)
        if time_ms >= self._due_ms:
            self._due_ms += self._frame_ms
            self._on_image(self._render())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._body, name)


@contextmanager
def filmed(body: Body, path: Path) -> Iterator[Body]:
    """Film a robot into an mp4 file inside this context, in simulated time. Use the body that it yields.

    Raises:
        RenderingUnavailableError: no OpenGL library works here.
        TwinError: the robot has no MuJoCo model, or the file is no mp4.
    """
    if not isinstance(body, MujocoBody):
        raise TwinError(f"there is nothing to see of robot '{body.robot.name}'; film one with a MuJoCo model")
    if path.suffix.lower() != ".mp4":
        raise TwinError(f"'{path}' is not a name of a film; end it in .mp4")
    # The writer is closed, not entered: the film is kept even if the program raises.
    with Renderer(body, *SIZE) as renderer, closing(VideoWriter(path, 1000 / _FRAME_MS)) as video:
        video.add(renderer.render())
        yield Filmed(body, renderer.render, _FRAME_MS, _FRAME_MS, video.add)
