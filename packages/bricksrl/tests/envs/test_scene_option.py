"""The option ``scene``: a task in other surroundings, such as on a photograph of a mat."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from PIL import Image

from bricksrl.envs import EnvOptions, get_task, make
from bricksrl.envs.registry import task_with
from bricksrl.errors import BricksError, DescriptionError
from bricksrl.evaluation.evaluator import evaluation_options
from bricksrl.training.config import TrainConfig, code_in, portable
from bricksrl.training.run_folder import RunFolder
from bricktwin.worlds import world

SCENE = "mat.png:800x400"


@pytest.fixture(autouse=True)
def mat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a black mat."""
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (800, 400), "black").save("mat.png")
    return tmp_path


def test_robot_learns_on_the_picture(mat: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the light of the edge of a line comes back on the task's own floor, and none on the
    mat; its path holds in any folder."""
    options = EnvOptions(scene=SCENE)
    (mat / "elsewhere").mkdir()
    monkeypatch.chdir(mat / "elsewhere")
    seen = []
    for named in (EnvOptions(), options):
        with closing(make("LineFollow-v0", named, seed=0, arrays=True)) as robot:
            names = [entry.name for entry in robot.task.entries]
            seen.append(float(robot.begin().observation[names.index("light_reflection")]))
    on_edge, on_mat = seen
    assert on_mat < 15 < on_edge


def test_world_is_a_scene() -> None:
    assert task_with("LineFollow-v0", EnvOptions(scene="maze")).scene == world("maze")
    assert task_with("LineFollow-v0", EnvOptions()) == get_task("LineFollow-v0")


@pytest.mark.parametrize(
    ("env_id", "options", "says"),
    [
        ("LineFollow-v0", {"scene": "mazes"}, "did you mean 'maze'"),
        ("LineFollow-v0", {"scene": "none.png:fll"}, "there is no picture"),
        ("LineFollow-v0", {"scene": "maze", "hub": "ble"}, "a real robot has its own time"),
        ("WalkerSim-v0", {"scene": "maze"}, "is simulated without a robot"),
    ],
)
def test_scene_without_effect_is_refused(env_id: str, options: dict[str, str], says: str) -> None:
    with pytest.raises(BricksError, match=says):
        make(env_id, **options)


def test_run_keeps_its_scene(mat: Path) -> None:
    """Its evaluation is on the same floor; another hub or environment has its own."""
    config = TrainConfig(env="LineFollow-v0", agent="random", scene=SCENE)
    (mat / "run").mkdir()
    folder = RunFolder(mat / "run")
    folder.write_config(config)
    again = folder.read_config()
    assert again.scene == f"{mat / 'mat.png'}:800x400"
    origin = folder.origin()
    assert evaluation_options(origin, "LineFollow-v0").scene == again.scene
    assert evaluation_options(origin, "Park-v0").scene is None
    assert evaluation_options(origin, "LineFollow-v0", hub="ble").scene is None
    assert portable(config.to_dict())["scene"] == SCENE


def test_only_scenes_in_files_of_code_need_trust() -> None:
    for scene, code in (("maze", ()), (SCENE, ()), ("my_scene.py:MAT", ("my_scene.py:MAT",))):
        assert code_in({"env": "LineFollow-v0", "scene": scene}) == code


def test_robot_on_the_bench_is_in_no_scene(mat: Path) -> None:
    (mat / "my_task.py").write_text(
        "from dataclasses import replace\n"
        "from brickhub.robot import HubKind, Motor, Robot\n"
        "from bricksrl.envs import get_task\n"
        "task = get_task('RoboArm-v0')\n"
        "TASK = replace(task, id='Bench-v0', robot=replace(task.robot, model=None))\n"
    )
    with pytest.raises(DescriptionError, match="lies on the bench"):
        task_with("my_task.py:TASK", EnvOptions(scene="maze"))
