"""Films of policies on virtual robots, with a room, captions and goals; of two policies side by side; of an arena's robots."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brickhub.files import check_writable
from bricksrl.envs.env_interface import interface_of
from bricksrl.errors import TwinError

if TYPE_CHECKING:
    from tensordict.nn import TensorDictModuleBase
    from torchrl.envs import EnvBase

    from bricksrl.envs.connection import Connection
    from bricksrl.envs.rollout import Policy
    from bricktwin.twin.mujoco_body import MujocoBody
    from bricktwin.twin.render.opengl import Image, Renderer, VideoWriter
    from bricktwin.twin.render.video import Room

QUICK_S = 0.03
"""Longest time to draw an image without shadows for shadows to be tried."""
_LAST_S = 0.8
"""Duration of the last image of an episode."""
_HOLDS = (1, 2, 3, 4)
_NORMAL_SPEED_S, _SPEED = 12.0, 2.0
"""Longer episodes are shown twice as fast."""
_ARENA_FRAME_MS, _RECORDED_FRAME_MS = 50, 80


@dataclass(frozen=True)
class FilmOptions:
    """Options of a film.

    Attributes:
        title: caption of each image; by default the task's id.
        episodes: number of episodes, shown one after the other.
        seed: seed of the episodes.
        size: width and height in px.
        budget_s: approximate time for drawing; a small one reduces the frame rate.
    """

    title: str = ""
    episodes: int = 1
    seed: int = 1000
    size: tuple[int, int] = (1280, 720)
    budget_s: float = 40.0


@dataclass(frozen=True)
class Film:
    """A film, and the return and the distance forward (m; 0 unless the robot walks) of each of its episodes."""

    path: Path
    returns: tuple[float, ...]
    forward_m: tuple[float, ...]


def check_film(path: Path) -> None:
    """Raise TwinError unless the name ends in .mp4, WriteError if the file cannot be written."""
    if path.suffix.lower() != ".mp4":
        raise TwinError(f"'{path}' is not a name of a film; end it in .mp4")
    check_writable(path)


def check_filmable(env: EnvBase) -> None:
    """Raise TwinError unless an environment has a virtual robot with a body that can be seen."""
    from bricktwin.twin.make_body import lies_on_bench

    if interface_of(env).robots != 1:
        raise TwinError(f"{env.task.id} has no virtual robot to film; choose an environment with a hub")
    if lies_on_bench(env.task.robot, env.task.scene):
        raise TwinError(
            f"{env.task.id} has nothing to film, as its robot lies on a bench; describe a drive base, a plan or a model of it"
        )


def film(
    env: EnvBase, act: Policy, path: Path, options: FilmOptions | None = None, *, reset: Callable[[], None] = lambda: None
) -> Film:
    """Film a policy into an mp4 file.

    Args:
        env: an environment with a virtual robot that has a MuJoCo model.
        reset: resets the policy's state at the start of each episode.

    Raises:
        RenderingUnavailableError: no OpenGL library works here.
        TwinError: the environment has no such robot.
    """
    check_filmable(env)
    from brickhub.seed import derive_seed
    from bricksrl.envs.rollout import play, seed_episode
    from bricksrl.envs.transforms import own_frames
    from bricktwin.twin.mujoco_body import MujocoBody
    from bricktwin.twin.render.opengl import VideoWriter
    from bricktwin.twin.render.video import Filmed

    options = options or FilmOptions()
    returns, distances_m = [], []
    with VideoWriter(path, 25.0) as video:
        for number in range(1, options.episodes + 1):
            seed_episode(env, derive_seed(options.seed, "evaluation", number))
            start = env.reset()
            twin = interface_of(env).twin
            if twin is None or not isinstance(twin.body, MujocoBody):
                raise TwinError(f"{env.task.id} has no virtual robot to film")
            take = _Take(env, twin.body, options, number, start, video)
            with closing(take.renderer), ExitStack() as after:
                after.callback(setattr, twin.machine, "body", twin.machine.body)
                twin.machine.body = Filmed(twin.machine.body, take.render, take.frame_ms, twin.machine.time_ms, take.show)
                for frame in play(env, act, start, reset_policy=reset):
                    rewards = [float(own["next", "reward"]) for own in own_frames(env, frame)]
                    take.reward, take.total, take.step = rewards[-1], take.total + sum(rewards), take.step + len(rewards)
                take.show(take.render(), round(25 * _LAST_S))
            returns.append(take.total)
            distances_m.append(take.forward_m)
    return Film(path, tuple(returns), tuple(distances_m))


@dataclass
class _Take:
    """Recording of one episode, drawn and written while the robot moves: an image every ``frame_ms`` of simulated time."""

    env: EnvBase
    body: MujocoBody
    options: FilmOptions
    number: int
    start: Any
    video: VideoWriter
    total: float = 0.0
    step: int = 0
    reward: float = 0.0

    def __post_init__(self) -> None:
        from bricksrl.envs.transforms import own_state
        from bricktwin.twin.render.video import Room

        entries = zip(self.env.task.entries, own_state(self.env, self.start)["observation"].tolist(), strict=False)
        goals = {entry.name.removesuffix("_goal"): angle for entry, angle in entries if entry.name.endswith("_goal")}
        self.room: Room = Room(self.body, goals)
        self.renderer, cost_s = self._renderer()
        expected_s = self.env.task.max_steps / self.env.task.rate_hz
        self.speed = _SPEED if expected_s > _NORMAL_SPEED_S else 1.0
        affordable = max(1.0, self.options.budget_s / self.options.episodes / cost_s)
        # At 25 images/s, an image covers 40 ms at speed 1; if that is too many to draw in the budget, each is held for longer.
        self.hold = next((n for n in _HOLDS if expected_s * 25 / (n * self.speed) <= affordable), _HOLDS[-1])
        self.frame_ms = round(40 * self.speed * self.hold)

    def _renderer(self) -> tuple[Renderer, float]:
        """A renderer, with shadows if they are fast enough, and its time per image."""
        from bricktwin.twin.render.opengl import Renderer

        width, height = self.options.size

        def make(*, shadows: bool) -> tuple[Renderer, float]:
            renderer = Renderer(
                self.body, width, height, self.room.camera, shadows=shadows, smooth=shadows, decorate=self.room.decorate
            )
            renderer.render()
            start_s = time.perf_counter()
            renderer.render()
            return renderer, time.perf_counter() - start_s

        plain, cost_s = make(shadows=False)
        if cost_s > QUICK_S:
            return plain, cost_s
        shaded, shaded_s = make(shadows=True)
        if shaded_s > 2 * QUICK_S:
            shaded.close()
            return plain, cost_s
        plain.close()
        return shaded, shaded_s

    def render(self) -> Image:
        """One image with captions."""
        from bricktwin.twin.render.video import captioned

        self.room.follow()
        image = self.renderer.render()
        parts = [f"episode {self.number}"] if self.options.episodes > 1 else []
        parts += [f"step {self.step}", f"reward {self.reward:.2f}", f"return {self.total:.1f}"]
        if self.env.task.walks:
            parts.append(f"distance {self.forward_m:.2f} m")
        if self.speed != 1.0:
            parts.append(f"{self.speed:g}x speed")
        marks = self.room.metre_marks(*self.options.size)
        return captioned(image, self.options.title or self.env.task.id, "   ".join(parts), marks)

    @property
    def forward_m(self) -> float:
        """Distance forward so far; 0 unless the robot walks."""
        return float(interface_of(self.env).walk_metrics().get("forward_m", 0.0))

    def show(self, image: Image, times: int = 0) -> None:
        """Add an image to the film, ``hold`` times by default."""
        for _ in range(times or self.hold):
            self.video.add(image)


@contextmanager
def filmed_env(env: EnvBase, path: Path | None, title: str) -> Iterator[None]:
    """Film the virtual robot of an environment inside this context, however it ends; without a path do nothing. Raises TwinError
    if there is no virtual robot to film, or the file is no mp4, RenderingUnavailableError if no OpenGL library works here."""
    if path is None:
        yield
        return
    from bricktwin.twin.mujoco_body import MujocoBody
    from bricktwin.twin.render.opengl import Renderer, VideoWriter
    from bricktwin.twin.render.video import Filmed, Room, captioned

    check_film(path)
    check_filmable(env)
    size, number = (1280, 720), 0
    video, renderers = VideoWriter(path, 1000 / _RECORDED_FRAME_MS), ExitStack()

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

        machine.body = Filmed(machine.body, render, _RECORDED_FRAME_MS, machine.time_ms, video.add)

    with closing(video), renderers, ExitStack() as watch:
        watch.callback(interface_of(env).watch(install))
        yield


def side_by_side(left: Path, right: Path, path: Path, height: int = 540) -> Path:
    """Join two films side by side, each ``height`` px high, for the duration of the longer one. Raises TwinError if they cannot
    be joined."""
    import imageio_ffmpeg

    fit = f"scale=-2:{height},setsar=1"
    graph = f"[0:v]{fit}[a];[1:v]{fit}[b];[a][b]hstack=inputs=2"  # the last image of the shorter one stays
    inputs = [word for film in (left, right) for word in ("-i", f"file:{film}")]  # a colon in a name ends no protocol
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", *inputs, "-filter_complex", graph]
    command += ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "26", "-movflags", "+faststart", f"file:{path}"]
    process = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  our own arguments
    if process.returncode:
        raise TwinError(f"{left} and {right} cannot be joined ({' '.join(process.stderr.split())[:120]}); make them again")
    return path


def film_run(run_dir: Path, which: str, path: Path, options: FilmOptions, **changes: Any) -> Film:
    """Film the policy of a run: ``first`` (untrained), ``best``, ``last``, or ``random`` actions. ``changes``: fields of
    `EnvOptions` that differ from the training. Raises RunError or CheckpointError if there is no such run or policy,
    RenderingUnavailableError or TwinError as :func:`film`."""
    from bricksrl.envs.registry import make_env
    from bricksrl.evaluation.evaluator import evaluation_options
    from bricksrl.policies.policy import named_policies
    from bricksrl.training.run_folder import RunFolder

    origin = RunFolder(run_dir).origin()
    filmed = evaluation_options(origin, origin.env, hub="virtual", **changes)
    with closing(make_env(origin.env, filmed, seed=origin.seed)) as env:
        policy = named_policies(run_dir, env, options.seed)[which]()
        return film(env, policy.act, path, options, reset=policy.reset)


def film_arena(env: EnvBase, policy: TensorDictModuleBase, path: Path, episodes: int, seed: int) -> None:
    """Film episodes of an arena into an mp4 file, without exploration. Raises RenderingUnavailableError if no OpenGL library
    works here."""
    import torch
    from torchrl.envs.utils import ExplorationType, set_exploration_type

    from bricksrl.envs.rollout import play
    from bricktwin.twin.render.opengl import Renderer, VideoWriter

    with VideoWriter(path, 1000 / _ARENA_FRAME_MS) as video:
        for episode in range(episodes):
            env.set_seed(seed + episode)
            with Renderer(env.world.bodies[0], 480, 360, "arena") as renderer:
                due_ms = 0

                def draw(time_ms: int, renderer: Renderer = renderer) -> None:
                    nonlocal due_ms
                    if time_ms >= due_ms:
                        due_ms = time_ms + _ARENA_FRAME_MS
                        video.add(renderer.render())

                state = env.reset()
                env.world.on_time = draw
                with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
                    for _ in play(env, policy, state):
                        pass
