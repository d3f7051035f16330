"""A short film of a trained policy on its virtual robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from bricksrl.errors import TwinError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent
    from bricksrl.twin.rendering import Image, Renderer

_FRAME_MS = 80
_SEED = 1000


def record(run_dir: Path) -> Path:
    """Film one episode of a run's agent into ``video.mp4`` in its folder, as fast as the robot moves.

    Raises:
        RenderingUnavailableError: no OpenGL library works here.
        TwinError: the environment has no virtual robot.
    """
    from bricksrl.training import RunFolder, load_agent
    from bricksrl.training.runner import make_env
    from bricksrl.twin.film import SIZE
    from bricksrl.twin.rendering import Renderer, write_video

    config = RunFolder(run_dir).read_config()
    env = make_env(config)
    try:
        env.set_seed(_SEED)
        agent = load_agent(run_dir, env).agent
        twin = getattr(env, "twin", None)
        if twin is None:
            raise TwinError(f"{config.env} has no virtual robot to film")
        with Renderer(twin.body, *SIZE) as renderer:
            return write_video(run_dir / "video.mp4", _film(env, agent, renderer), 1000 / _FRAME_MS)
    finally:
        env.close(raise_if_closed=False)


def _film(env: EnvBase, agent: Agent, renderer: Renderer) -> Iterator[Image]:
    from bricksrl.agents.agent import look
    from bricksrl.twin.film import Filmed

    state = env.reset()
    machine = env.twin.machine
    images: list[Image] = []
    machine.body = Filmed(machine.body, renderer, _FRAME_MS, machine.time_ms, images.append)
    done = False
    agent.start_acting()
    while not done:
        state["action"] = agent.act(look(agent, state), explore=False)
        outcome = env.step(state)["next"]
        yield from images
        images.clear()
        done, state = bool(outcome["done"]), outcome
