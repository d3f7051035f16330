"""Videos of programs."""

from __future__ import annotations

import io
from contextlib import nullcontext
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from videos import read_video

from brickhub.errors import RenderingUnavailableError, TwinError
from brickhub.virtual.run import run_file
from bricktwin.cli import main
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.render.opengl import Renderer
from bricktwin.twin.render.video import captioned, filmed
from bricktwin.twin.scene import Scene

DRIVE = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
from pybricks.tools import wait
motor = Motor(Port.A)
motor.run(500)
wait(1000)
print(motor.angle())
"""


@pytest.fixture(scope="module", autouse=True)
def _opengl() -> None:
    try:
        Renderer(MujocoBody(TWO_WHEELER, Scene(), Physics(), 0), 16, 16).close()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))


def film(
    folder: Path, source: str, video: Path | None, time_limit_s: float | None = None
) -> tuple[int, str, str]:
    path = folder / "main.py"
    path.write_text(source)
    out, err = io.BytesIO(), io.StringIO()
    body = make_body(TWO_WHEELER)
    with nullcontext(body) if video is None else filmed(body, video) as seen:
        code = run_file(path, seen, stdout=out, stderr=err, time_limit_s=time_limit_s)
    return code, out.getvalue().decode(), err.getvalue()


def test_program_video_has_simulated_speed(tmp_path: Path) -> None:
    video = tmp_path / "films" / "drive.mp4"
    assert film(tmp_path, DRIVE, video) == film(tmp_path, DRIVE, None)
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(video))
    assert count == 26 and seconds == pytest.approx(1.04, abs=0.05)
    first, *_, last = read_video(video)
    assert first.shape == (360, 480, 3) and np.abs(first.astype(int) - last).max() > 50, "it turned"


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("source", "time_limit_s", "count", "code"),
    [
        ("print(1)", None, 1, 0),
        (DRIVE + "while True: wait(10)", 0.4, 11, 124),
        (DRIVE + "1 / 0", None, 26, 1),
    ],
)
def test_video_is_complete_however_program_ends(
    tmp_path: Path, source: str, time_limit_s: float | None, count: int, code: int
) -> None:
    video = tmp_path / "end.mp4"
    assert film(tmp_path, source, video, time_limit_s)[0] == code
    assert len(read_video(video)) == count


def test_unfilmable_program_raises(tmp_path: Path, capsys) -> None:
    (tmp_path / "main.py").write_text("print(1)")
    with pytest.raises(TwinError, match=r"end it in \.mp4"):
        film(tmp_path, "print(1)", tmp_path / "film.avi")
    for options, says in (
        (("--robot", "bench"), "nothing to see of robot 'bench'"),
        (
            ("--hub", "ble"),
            "a real hub has its own robot, buttons and time; leave out --hub, or --video",
        ),
    ):
        assert (
            main(("run", str(tmp_path / "main.py"), *options, "--video", str(tmp_path / "a.mp4")))
            == 2
        )
        captured = capsys.readouterr()
        assert captured.out == "" and captured.err.startswith("error: ") and says in captured.err


@pytest.mark.parametrize("line", ["", "return 12"])
def test_text_has_a_box_of_its_size_and_the_rest_stays(line: str) -> None:
    paper = np.full((360, 640, 3), 200, np.uint8)
    changed = (captioned(paper, "Walker-v0", line) != paper).any(2)
    rows, columns = np.flatnonzero(changed.any(1)), np.flatnonzero(changed.any(0))
    # Margins of 8 pixels; 13 for the title, and 10 for a line, 4 below it.
    height_px = 2 * 8 + 13 + (4 + 10 if line else 0)
    assert (rows[0], columns[0]) == (8, 8)
    assert rows[-1] - rows[0] + 1 == height_px
    assert columns[-1] < 200
