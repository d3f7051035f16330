"""What is drawn for a film, and when: on a clock of the test's, without OpenGL."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torchrl.envs.utils import ExplorationType, exploration_type

from brickhub.seed import episode_seed, evaluation_seed
from bricksrl import make
from bricksrl.envs import get_task
from bricksrl.errors import TwinError
from bricksrl.evaluation import film


class Clock:
    """Time in seconds that passes while an image is drawn."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def perf_counter(self) -> float:
        return self.now_s


def drawn_by(
    monkeypatch: pytest.MonkeyPatch,
    plain_s: float,
    shaded_s: float,
) -> list[Any]:
    """Renderers that are made, whose images take these times; the first one takes a second more."""
    clock = Clock()
    made: list[Any] = []

    class Renderer:
        def __init__(self, body: Any, width: int, height: int, camera: Any, **looks: Any) -> None:
            self.size = (width, height)
            self.looks = looks
            self.is_open = True
            self.images = 0
            made.append(self)

        def render(self) -> str:
            clock.now_s += shaded_s if self.looks["shadows"] else plain_s
            clock.now_s += 1.0 if self.images == 0 else 0.0
            self.images += 1
            return "image"

        def close(self) -> None:
            self.is_open = False

    monkeypatch.setattr(film, "Renderer", Renderer)
    monkeypatch.setattr(film, "time", clock)
    return made


@pytest.mark.parametrize(
    ("plain_s", "shaded_s", "tried", "is_shaded"),
    [
        (0.25, 0.5, 2, True),
        (0.25, 0.53125, 2, False),
        (0.5, 0.75, 2, True),
        (0.5, 1.0, 2, True),
        (0.5, 1.0625, 2, False),
        (0.53125, 0.5, 1, False),
    ],
)
def test_shadows_are_drawn_where_there_is_time_for_them(
    monkeypatch: pytest.MonkeyPatch,
    plain_s: float,
    shaded_s: float,
    tried: int,
    is_shaded: bool,
) -> None:
    """An image may take half a second in the first two rows, else a second."""
    limit_s = 0.5 if plain_s == 0.25 else 1.0
    made = drawn_by(monkeypatch, plain_s, shaded_s)
    room: Any = SimpleNamespace(camera=None, decorate=None)
    renderer, cost_s = film._renderer(None, room, (64, 36), limit_s)  # type: ignore[arg-type]
    assert len(made) == tried
    assert [each.is_open for each in made] == [each is renderer for each in made]
    assert renderer.looks["shadows"] is is_shaded and renderer.looks["smooth"] is is_shaded
    assert cost_s == (shaded_s if is_shaded else plain_s)
    assert renderer.size == (64, 36)


@pytest.fixture
def video(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Captions of the images of a film that is not written."""
    captions: list[str] = []

    class Writer:
        def __init__(self, path: Path, fps: float) -> None:
            assert fps == 25

        def add(self, image: str) -> None:
            captions.append(image)

        def close(self) -> None:
            """Nothing was opened."""

    monkeypatch.setattr(film, "VideoWriter", Writer)
    monkeypatch.setattr(film, "captioned", lambda image, title, text, marks: f"{title}: {text}")
    return captions


@pytest.mark.parametrize(
    ("cost_s", "hold"), [(0.0, 1), (0.1, 1), (0.11, 2), (0.2, 2), (0.21, 3), (0.39, 4), (9.0, 4)]
)
def test_images_are_held_where_drawing_takes_long(
    monkeypatch: pytest.MonkeyPatch, video: list[str], cost_s: float, hold: int
) -> None:
    """An episode of 1 s has 25 images of 0.04 s each; of 2.5 s of drawing each may take 0.1 s."""
    renderer = SimpleNamespace(render=lambda: "image", close=lambda: None)
    monkeypatch.setattr(film, "_renderer", lambda *_: (renderer, cost_s))
    task = get_task("Spinning-v0")
    steps = round(task.rate_hz)
    with closing(make("Spinning-v0", seed=0)) as env:
        env.task = replace(task, max_steps=steps)
        with film.filmed_env(env, Path("spin.mp4"), "Spin", budget_s=2.5):
            state = env.reset()
            rewards = []
            for _ in range(steps):
                state["action"] = torch.tensor([1.0, -1.0])
                out = env.step(state)["next"]
                rewards.append(float(out["reward"]))
                state = out.clone()
            on_s = env.twin.machine.time_ms / 1000
    last = video[-1]
    assert last.startswith(f"Spin: episode 1   step {steps}   reward {rewards[-1]:.2f}")
    assert f"return {sum(rewards):.1f}" in last
    assert "speed" not in last
    # The end is shown for 0.8 s, and before it each image as often as it is held.
    assert video[-20:] == [last] * 20 and video[-21] != last
    moving = video[:-20]
    assert len(moving) % hold == 0
    for start in range(0, len(moving), hold):
        assert len(set(moving[start : start + hold])) == 1
    # It lasts as long as the steps did, and at most as long as the robot was on.
    assert 1.0 < len(moving) / 25 <= on_s


def test_long_episode_is_shown_at_double_speed(
    monkeypatch: pytest.MonkeyPatch, video: list[str]
) -> None:
    renderer = SimpleNamespace(render=lambda: "image", close=lambda: None)
    limits: list[float] = []

    def make_renderer(body: Any, room: Any, size: Any, limit_s: float) -> Any:
        limits.append(limit_s)
        return renderer, 0.0

    monkeypatch.setattr(film, "_renderer", make_renderer)
    task = get_task("Walker-v0")
    assert task.max_steps / task.rate_hz > 12
    with closing(make("Walker-v0", seed=0)) as env:
        with film.filmed_env(env, Path("walk.mp4"), "Walk", budget_s=3.0):
            state = env.reset()
            for _ in range(3):
                state["action"] = torch.ones(4)
                state = env.step(state)["next"].clone()
        walked_m = env.episode.odometer.metrics()["forward_m"]
    seconds = task.max_steps / task.rate_hz
    # At double speed the film has half as many images, each of which may take twice as long.
    assert limits == [pytest.approx(3.0 * 2 / (25 * seconds))]
    assert video[-1].split("   ")[0] == "Walk: episode 1"
    assert video[-1].split("   ")[-2:] == [f"distance {walked_m:.2f} m", "2x speed"]
    images = 25 * 3 / task.rate_hz
    assert images / 2 <= len(video) - 20 < images, "a step lasts a little longer, with its link"


def test_robot_on_a_bench_is_not_filmed() -> None:
    task = get_task("RoboArm-v0")
    for env, why in [
        (SimpleNamespace(task=task, robots=0), "has no virtual robot to film; choose an env"),
        (SimpleNamespace(task=task, robots=2), "has no virtual robot to film; choose an env"),
    ]:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(film, "interface_of", lambda given: given)
            with pytest.raises(TwinError, match=f"^RoboArm-v0 {why}"):
                film.check_filmable(env)  # type: ignore[arg-type]


def test_arena_is_filmed_twenty_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of simulated time; each episode of its own seed, at its best."""
    monkeypatch.setattr(film, "VideoWriter", Twenty)
    monkeypatch.setattr(film, "Renderer", lambda *given: Camera(given))
    Twenty.images = []
    seeds: list[int] = []
    listeners: list[Any] = []
    world = SimpleNamespace(bodies=("first", "second"), on_time=listeners)
    env: Any = SimpleNamespace(world=world, set_seed=seeds.append, reset=lambda: "the start")

    def play(given: Any, policy: Any, state: Any) -> Any:
        assert (given, policy, state) == (env, "the policy", "the start")
        assert exploration_type() is ExplorationType.DETERMINISTIC
        for time_ms in (0, 20, 50, 99, 100, 160, 209, 210):
            listeners[-1](time_ms)
            yield time_ms

    monkeypatch.setattr(film, "play", play)
    policy: Any = "the policy"
    film.film_arena(env, policy, Path("arena.mp4"), 2, 7)
    assert seeds == [episode_seed("evaluation", 7, 1), episode_seed("evaluation", 7, 2)]
    assert Twenty.images == [("first", 480, 360, "arena")] * 10


class Twenty:
    """A film of twenty images a second that is not written."""

    images: list[Any]

    def __init__(self, path: Path, fps: float) -> None:
        assert fps == 20

    def add(self, image: Any) -> None:
        Twenty.images.append(image)

    def __enter__(self) -> Twenty:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing was opened."""


class Camera(AbstractContextManager["Camera"]):
    """A renderer whose images are what it was made of."""

    def __init__(self, given: Any) -> None:
        self.given = given

    def render(self) -> Any:
        return self.given

    def __exit__(self, *_: object) -> None:
        """Nothing was opened."""


@pytest.mark.parametrize(("metrics", "forward_m"), [({"forward_m": 1.25}, 1.25), ({}, 0.0)])
def test_filmed_episode_of_a_run_is_the_first_of_its_evaluation(
    monkeypatch: pytest.MonkeyPatch, metrics: dict[str, float], forward_m: float
) -> None:
    asked: list[Any] = []
    env = SimpleNamespace(close=lambda: asked.append("closed"))
    origin = SimpleNamespace(seed=5)
    monkeypatch.setattr(film, "RunFolder", lambda path: SimpleNamespace(origin=lambda: origin))
    monkeypatch.setattr(film, "_env_of_run", lambda given: env)
    monkeypatch.setattr(film, "check_filmable", lambda given: asked.append("checked"))
    player = SimpleNamespace(act="act", reset="reset")

    def named_policies(path: Path, given: Any, seed: int) -> Any:
        return {"first": lambda: (path, seed), "last": lambda: player}

    @contextmanager
    def filmed_env(given: Any, *where: Any, **looks: Any) -> Iterator[None]:
        asked.append((*where, looks))
        yield

    def play_episodes(given: Any, *how: Any, reset_policy: Any) -> Any:
        asked.append((*how, reset_policy))
        return [SimpleNamespace(return_=2.5, metrics=metrics)]

    monkeypatch.setattr(film, "named_policies", named_policies)
    monkeypatch.setattr(film, "filmed_env", filmed_env)
    monkeypatch.setattr(film, "play_episodes", play_episodes)
    path = Path("a.mp4")
    found = film.film_run(Path("run"), "last", path, "title", size=(64, 36), budget_s=0.5)
    assert found == film.Film(path, 2.5, forward_m)
    assert asked == [
        "checked",
        (path, "title", {"size": (64, 36), "budget_s": 0.5}),
        ("act", 1, evaluation_seed(5, 1000), "reset"),
        "closed",
    ]


@pytest.mark.parametrize("has_body", [False, True])
def test_run_is_tried_with_a_small_image(monkeypatch: pytest.MonkeyPatch, has_body: bool) -> None:
    drawn: list[Any] = []

    class Body:
        """Stands for a body of MuJoCo."""

    class Small(Camera):
        def render(self) -> Any:
            drawn.append(self.given[1:])

    task = SimpleNamespace(robot="robot", scene="scene")
    env = SimpleNamespace(task=task, close=lambda: drawn.append("closed"))
    monkeypatch.setattr(film, "RunFolder", lambda path: SimpleNamespace(origin=lambda: None))
    monkeypatch.setattr(film, "_env_of_run", lambda origin: env)
    monkeypatch.setattr(film, "check_filmable", lambda given: None)
    body = Body() if has_body else None
    monkeypatch.setattr(film, "make_body", lambda robot, *, scene: body)
    monkeypatch.setattr(film, "MujocoBody", Body)
    monkeypatch.setattr(film, "Room", lambda given: SimpleNamespace(camera="camera"))
    monkeypatch.setattr(film, "Renderer", lambda *given: Small(given))
    film.check_run_filmable(Path("run"))
    assert drawn == (["closed", (64, 36, "camera")] if has_body else ["closed"])
