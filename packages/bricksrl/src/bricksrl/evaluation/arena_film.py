"""Films of robots that share one world."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tensordict.nn import TensorDictModuleBase
    from torchrl.envs import EnvBase

_FRAME_MS = 50


def film_arena(env: EnvBase, policy: TensorDictModuleBase, path: Path, episodes: int, seed: int) -> int:
    """Film episodes of an arena into an mp4 file, without exploration; returns the number of images. Raises
    RenderingUnavailableError if no OpenGL library works here."""
    import torch
    from torchrl.envs.utils import ExplorationType, set_exploration_type

    from bricksrl.envs.rollout import play
    from bricktwin.twin.render.opengl import Renderer, VideoWriter

    images = 0
    with VideoWriter(path, 1000 / _FRAME_MS) as video:
        for episode in range(episodes):
            env.set_seed(seed + episode)
            with Renderer(env.world.bodies[0], 480, 360, "arena") as renderer:
                due_ms = 0

                def draw(time_ms: int, renderer: Renderer = renderer) -> None:
                    nonlocal due_ms, images
                    if time_ms >= due_ms:
                        due_ms, images = time_ms + _FRAME_MS, images + 1
                        video.add(renderer.render())

                state = env.reset()
                env.world.on_time = draw
                with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
                    for _ in play(env, policy, state):
                        pass
    return images
