"""Films of robots that share one world."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bricksrl.training.teams.team import play_team

if TYPE_CHECKING:
    from tensordict.nn import TensorDictModuleBase
    from torchrl.envs import EnvBase

_FRAME_MS = 50


def film_arena(env: EnvBase, policy: TensorDictModuleBase, path: Path, episodes: int, seed: int) -> int:
    """Film episodes of an arena into an mp4 file, without exploration; returns the number of images. Raises
    RenderingUnavailableError if no OpenGL library works here, HubError if a link broke."""
    from bricksrl.twin.render.opengl import Renderer, VideoWriter

    images = due_ms = 0
    with VideoWriter(path, 1000 / _FRAME_MS) as video, Renderer(env.world.bodies[0], 480, 360, "arena", shadows=True) as renderer:

        def draw(time_ms: int) -> None:
            nonlocal due_ms, images
            if time_ms >= due_ms:
                due_ms, images = time_ms + _FRAME_MS, images + 1
                video.add(renderer.render())

        def begin() -> None:
            nonlocal due_ms
            due_ms, env.world.on_time = 0, draw

        not_drawing = env.world.on_time
        for episode in range(episodes):
            play_team(env, policy, 1, seed + episode, begin)
            env.world.on_time = not_drawing
    return images
