"""Films of an environment: what the camera follows, how long they are, what cannot be filmed."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
import torch
from videos import read_video

from bricksrl import make
from bricksrl.envs.env import HubEnv
from bricksrl.errors import RenderingUnavailableError, TwinError
from bricksrl.evaluation import film
from bricktwin.twin.render.video import Room

SMALL = {"size": (64, 36), "budget_s": 0.5}


@pytest.fixture
def rooms(monkeypatch: pytest.MonkeyPatch) -> list[Room]:
    """Rooms that are made for films."""
    made: list[Room] = []

    def room(*arguments: object) -> Room:
        made.append(Room(*arguments))  # type: ignore[arg-type]
        return made[-1]

    monkeypatch.setattr(film, "Room", room)
    return made


def drive(env: HubEnv, seed: int, steps: int) -> None:
    """Drive backward, away from the wall, in an episode of its own."""
    env.set_seed(seed)
    state = env.reset()
    for _ in range(steps):
        state["action"] = torch.full((1,), -1.0)
        state = env.step(state)["next"]


def test_camera_follows_the_robot_and_every_episode_is_in_the_film(
    rooms: list[Room], tmp_path: Path
) -> None:
    path = tmp_path / "away.mp4"
    with closing(make("RunAway-v0", seed=0)) as env:
        try:
            with film.filmed_env(env, path, "away", **SMALL):
                drive(env, 1, 5)
                drive(env, 2, 5)
        except RenderingUnavailableError as error:
            pytest.skip(str(error))
        assert len(rooms) == 2
        robot = float(rooms[-1]._body.data.qpos[0])
        assert abs(robot) > 0.1, "it has driven"
        # The camera lags behind.
        assert 0.2 < rooms[-1].camera.lookat[0] / robot < 1.0
    pictures = read_video(path)
    seconds = len(pictures) / 25
    assert pictures.shape[1:] == (36, 64, 3)
    # Ten steps, at double speed as the task is long, and twice the time in which the end is read. A
    # step lasts until the robot has driven, which is about the second that counts for it.
    wanted_s = 10 / env.task.rate_hz / film._SPEED + 2 * film._LAST_S
    assert seconds == pytest.approx(wanted_s, abs=1.0)


def test_no_film_without_a_body(tmp_path: Path) -> None:
    with closing(make("WalkerSim-v0", seed=0)) as env:
        with film.filmed_env(env, None, "nothing"):
            env.reset()
        with (
            pytest.raises(TwinError, match="no virtual robot to film"),
            film.filmed_env(env, tmp_path / "a.mp4", "nothing"),
        ):
            env.reset()
    assert list(tmp_path.iterdir()) == []
