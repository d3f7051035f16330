"""Films of virtual robots, with a room, captions and goals; of a run's policies; of an arena's
robots."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from brickhub.seed import episode_seed, evaluation_seed
from brickhub.virtual.faults import sound_body
from bricksrl.envs.connection import Connection
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.episode_state import EpisodeState
from bricksrl.envs.make import make
from bricksrl.envs.rollout import play, play_episodes
from bricksrl.errors import TwinError
from bricksrl.evaluation.evaluator import EVALUATION_SEED, evaluation_options
from bricksrl.policies.policy import named_policies
from bricksrl.training.run_folder import Origin, RunFolder
from bricktwin.twin.make_body import lies_on_bench, make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.render.opengl import Image, Renderer, VideoWriter
from bricktwin.twin.render.video import Filmed, Room, captioned, check_film

SIZE = (1280, 720)
"""Width and height in px."""
BUDGET_S = 15.0
"""Approximate time for drawing an episode; a small one reduces the frame rate."""
_FPS = 25
"""Images a second."""
_LAST_S = 0.8
"""Time for which the last image of an episode is shown, so that its numbers can be read."""
_HOLDS = (1, 2, 3, 4)
"""Numbers of images of the film that one drawn image may stand for."""
_NORMAL_SPEED_S = 12.0
"""Length of an episode up to which it is shown as fast as it was."""
_SPEED = 2.0
"""Speed of a longer one."""
_ARENA_FRAME_MS = 50
_TRIAL_PX = (64, 36)
"""Width and height of an image that nobody sees."""


@dataclass(frozen=True)
class Film:
    """A film of an episode, its return and its distance forward (m; 0 unless the robot walks)."""

    path: Path
    return_: float
    forward_m: float


def check_filmable(env: EnvBase) -> None:
    """Raise TwinError unless an environment has a virtual robot with a body that can be seen."""
    if interface_of(env).robots != 1:
        raise TwinError(
            f"{env.task.id} has no virtual robot to film; choose an environment with a hub"
        )
    if lies_on_bench(env.task.robot, env.task.scene):
        raise TwinError(
            f"{env.task.id} has nothing to film, as its robot lies on a bench; describe a drive "
            "base, a plan or a model of it"
        )


def check_run_filmable(run_dir: Path) -> None:
    """Raise as `film_run` if a run cannot be filmed, without filming it."""
    with closing(_env_of_run(RunFolder(run_dir).origin())) as env:
        check_filmable(env)
        task = env.task
        body = make_body(task.robot, scene=task.scene)
    if isinstance(body, MujocoBody):
        # Rendering a small image is the fastest way to find out whether OpenGL works here.
        with Renderer(body, *_TRIAL_PX, Room(body).camera) as renderer:
            renderer.render()


@contextmanager
def filmed_env(
    env: EnvBase,
    path: Path | None,
    title: str,
    *,
    size: tuple[int, int] = SIZE,
    budget_s: float = BUDGET_S,
) -> Iterator[None]:
    """Film the virtual robot of an environment inside this context, however it ends; without a path
    do nothing. Images are drawn and written while it moves, from the start of each episode to its
    end. Raises TwinError if there is no virtual robot to film, or the file is no mp4,
    RenderingUnavailableError if no OpenGL library works here."""
    if path is None:
        yield
        return
    check_film(path)
    check_filmable(env)
    ours = interface_of(env)
    task = env.task
    number = 0
    # This draws how the episode ended, once its last step is counted.
    last: list[Callable[[], Image]] = []
    expected_s = task.max_steps / task.rate_hz
    speed = _SPEED if expected_s > _NORMAL_SPEED_S else 1.0
    video = VideoWriter(path, _FPS)
    renderers = ExitStack()

    def end_episode() -> None:
        for draw in last:
            image = draw()
            for _ in range(round(_FPS * _LAST_S)):
                video.add(image)
        last.clear()
        renderers.close()

    def install(connection: Connection) -> None:
        nonlocal number
        end_episode()
        body = None if connection.twin is None else sound_body(connection.twin.body)
        if connection.twin is None or not isinstance(body, MujocoBody):
            raise TwinError(f"{task.id} has no virtual robot to film; leave out --video")
        # The goal is all zeros until the reset draws one.
        room = Room(body, task.goal([0.0] * len(task.entries)))
        # At 25 images/s, an image covers 40 ms at speed 1. If drawing takes too long, each image is
        # held for longer.
        limit_s = budget_s * speed / (expected_s * _FPS)
        renderer, cost_s = _renderer(body, room, size, limit_s)
        renderers.callback(renderer.close)
        hold = next((n for n in _HOLDS if cost_s <= n * limit_s), _HOLDS[-1])
        number = number + 1
        machine = connection.twin.machine

        def render(episode: EpisodeState | None) -> Image:
            parts = [f"episode {number}"]
            if episode is not None:
                room.aim_for(task.goal(episode.observation.tolist()))
                total = sum(episode.rewards)
                reward = episode.rewards[-1] if episode.rewards else 0.0
                parts += [
                    f"step {len(episode.rewards)}",
                    f"reward {reward:.2f}",
                    f"return {total:.1f}",
                ]
            if task.walks:
                walked = {} if episode is None else episode.odometer.metrics()
                parts.append(f"distance {walked.get('forward_m', 0.0):.2f} m")
            if speed != 1.0:
                parts.append(f"{speed:g}x speed")
            room.follow()
            return captioned(
                renderer.render(),
                title,
                "   ".join(parts),
                room.metre_marks(*size),
            )

        def show(image: Image) -> None:
            # Without an episode the robot is being placed, which nobody needs to see.
            if ours.episode is not None:
                last[:] = [partial(render, ours.episode)]
                for _ in range(hold):
                    video.add(image)

        # The film watches from between the hub and the body, and is removed after the episode.
        renderers.callback(
            setattr,
            machine,
            "body",
            machine.body,
        )
        period_ms = round(1000 / _FPS * speed * hold)
        machine.body = Filmed(
            machine.body,
            lambda: render(ours.episode),
            period_ms,
            machine.time_ms,
            show,
        )

    with closing(video), ExitStack() as watch:
        watch.callback(end_episode)
        watch.callback(ours.watch(install))
        yield


def _renderer(
    body: MujocoBody,
    room: Room,
    size: tuple[int, int],
    limit_s: float,
) -> tuple[Renderer, float]:
    """A renderer, with shadows if it draws an image with them in ``limit_s``, and its time per
    image."""

    def make(*, shadows: bool) -> tuple[Renderer, float]:
        renderer = Renderer(
            body,
            *size,
            room.camera,
            shadows=shadows,
            smooth=shadows,
            decorate=room.decorate,
        )
        # The first image loads textures and compiles shaders, so it is not typical.
        renderer.render()
        start_s = time.perf_counter()
        renderer.render()
        return renderer, time.perf_counter() - start_s

    plain, plain_s = make(shadows=False)
    # Shadows take twice the time at least, so on a slow computer not even the try is worth it.
    if 2 * plain_s > limit_s:
        return plain, plain_s
    shaded, shaded_s = make(shadows=True)
    if shaded_s <= limit_s:
        plain.close()
        return shaded, shaded_s
    shaded.close()
    return plain, plain_s


def film_run(
    run_dir: Path,
    which: str,
    path: Path,
    title: str,
    *,
    size: tuple[int, int] = SIZE,
    budget_s: float = BUDGET_S,
) -> Film:
    """Film an episode of a policy of a run: ``first`` (untrained), ``best``, ``last``, or
    ``random`` actions. Raises RunError or CheckpointError if there is no such run or policy,
    RenderingUnavailableError or TwinError as `filmed_env`."""
    origin = RunFolder(run_dir).origin()
    with closing(_env_of_run(origin)) as env:
        check_filmable(env)
        # The report shows the return of the first episode of its evaluation, so that one is filmed.
        seed = evaluation_seed(origin.seed, EVALUATION_SEED)
        policy = named_policies(run_dir, env, seed)[which]()
        with filmed_env(
            env,
            path,
            title,
            size=size,
            budget_s=budget_s,
        ):
            (score,) = play_episodes(
                env,
                policy.act,
                1,
                seed,
                reset_policy=policy.reset,
            )
    return Film(path, score.return_, score.metrics.get("forward_m", 0.0))


def _env_of_run(origin: Origin) -> EnvBase:
    """The environment in which a run is filmed: its twin, also of a run on a real robot."""
    options = evaluation_options(origin, origin.env, hub="virtual")
    return make(origin.env, options, seed=origin.seed)


def side_by_side(
    left: Path,
    right: Path,
    path: Path,
    height: int = 540,
) -> Path:
    """Join two films side by side, each ``height`` px high, for the duration of the longer one.
    Raises TwinError if they cannot be joined."""
    import imageio_ffmpeg

    fit = f"scale=-2:{height},setsar=1"
    # The last image of the shorter film stays until the end of the longer one.
    graph = f"[0:v]{fit}[a];[1:v]{fit}[b];[a][b]hstack=inputs=2"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-y", "-v", "error"]
    # After `file:`, a colon in a name does not mean a protocol.
    command += ["-i", f"file:{left}"]
    command += ["-i", f"file:{right}"]
    command += ["-filter_complex", graph]
    # Every browser plays this: H.264 with subsampled colours, and the index before the images.
    command += ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "26"]
    command += ["-movflags", "+faststart", f"file:{path}"]
    # The arguments are our own, and no shell reads them.
    process = subprocess.run(  # noqa: S603
        command,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if process.returncode:
        raise TwinError(
            f"{left} and {right} cannot be joined ({' '.join(process.stderr.split())[:120]}); "
            "make them again"
        )
    return path


def film_arena(
    env: EnvBase,
    policy: TensorDictModuleBase,
    path: Path,
    episodes: int,
    seed: int,
) -> None:
    """Film episodes of an arena into an mp4 file, without exploration. Raises
    RenderingUnavailableError if no OpenGL library works here."""
    with VideoWriter(path, 1000 / _ARENA_FRAME_MS) as video:
        for episode in range(episodes):
            env.set_seed(episode_seed("evaluation", seed, 1 + episode))
            with Renderer(
                env.world.bodies[0],
                480,
                360,
                "arena",
            ) as renderer:
                due_ms = 0

                def draw(time_ms: int, renderer: Renderer = renderer) -> None:
                    nonlocal due_ms
                    if time_ms >= due_ms:
                        due_ms = time_ms + _ARENA_FRAME_MS
                        video.add(renderer.render())

                state = env.reset()
                env.world.on_time.append(draw)
                with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
                    for _ in play(env, policy, state):
                        pass
