"""What is drawn for a film, and when: on a clock of the test's, without OpenGL."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

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
