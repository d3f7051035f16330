"""``bricksrl camera calibrate``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import torch

from bricksrl.cli import main
from bricksrl.envs.make import make
from bricksrl.envs.vision.camera import VideoCamera
from bricksrl.envs.vision.color_calibration import read_red
from bricksrl.envs.vision.frames import Frame, RedWindow
from bricksrl.errors import CameraError, RunError
from bricksrl.training import TrainConfig

ID = "RoboArm_mixed-v0"


def test_calibrate_camera_then_train(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "red.json"
    assert main(["camera", "calibrate", "--twin", "--frames", "2", "--out", str(path)]) == 0
    written = capsys.readouterr()
    assert written.err == ""
    assert "ball     at 3" in written.out
    assert str(path) in written.out
    window = read_red(path)
    assert window.hue_deg[0] < 0 < window.hue_deg[1]
    assert window != RedWindow()
    assert matplotlib.image.imread(path.with_suffix(".png")).shape[:2] == (480, 1280)
    told: list[TrainConfig] = []

    def note(config: TrainConfig, _observer: object, **_more: object) -> None:
        told.append(config)
        raise RunError("this is enough")

    monkeypatch.setattr("bricksrl.training.run.train", note)
    assert main(["train", ID, "--option", f"calibration={path}", "--option", "sparse=true"]) == 2
    assert told[0].options == {"calibration": str(path), "sparse": True}
    assert (
        TrainConfig.from_dict(json.loads(json.dumps(told[0].to_dict()))).options == told[0].options
    )
    env = make(ID, told[0].robot, seed=0)
    assert env.task.camera.goal.red == window
    assert env.task.reward(*[torch.zeros(1, 5)] * 3).item() == 1


def test_webcam_calibration_uses_last_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    taken: list[int | str] = []

    def frame(camera: VideoCamera) -> Frame:
        taken.append(camera._view.device)
        made = np.full((480, 640, 3), 120, np.uint8)
        made[100:140, 200:240] = (200, 30, 90) if len(taken) > 2 else (200, 90, 30)
        made[300:330, 200:240] = (210, 20, 90)
        return made

    monkeypatch.setattr(VideoCamera, "frame", frame)
    monkeypatch.setattr(
        "bricksrl.envs.vision.color_calibration.calibration_folder", lambda: tmp_path
    )
    assert (
        main(["camera", "calibrate", "--camera", "1", "--frames", "4", "--at", "220", "120"]) == 0
    )
    assert taken == [1] * 4
    assert read_red(tmp_path / "camera-1.json").hue_deg[1] < 0
    said = capsys.readouterr().out
    assert "ball     at 220, 120 (an area of 1600 px)" in said
    assert "2 red objects" in said


def test_mistakes_print_one_line(
    fails: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def unplugged(_camera: VideoCamera) -> None:
        raise CameraError("camera 0 shows nothing; plug it in")

    monkeypatch.setattr(VideoCamera, "frame", unplugged)
    fails("camera", "calibrate", says="camera 0 shows nothing")
    fails("camera", "calibrate", "--twin", says="--out")
    fails(
        "camera",
        "calibrate",
        "--twin",
        "--camera",
        "1",
        "--out",
        "x.json",
        says="--camera has no effect with --twin; omit it",
    )
    fails(
        "camera", "calibrate", "--out", "x.png", says="the name of the picture that is written too"
    )
    fails("camera", "calibrate", "--frames", "0", says="frames is 0")
    fails("camera", "calibrate", "Walker-v0", says="Walker-v0 has no camera")
    fails(
        "camera",
        "calibrate",
        "--twin",
        "--at",
        "3",
        "3",
        "--out",
        str(tmp_path / "red.json"),
        says="nothing is red",
    )
    fails("train", ID, "--option", "calibration", says="NAME=VALUE")
    fails("train", ID, "--option", "calibration=none.json", says="bricksrl camera calibrate")
    fails("train", ID, "--option", "colour=1", says="no option colour")
    assert not (tmp_path / "red.json").exists()
