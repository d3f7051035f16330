"""The pictures of a video."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray


def read_video(path: Path) -> NDArray[np.uint8]:
    """The frames of a video, uint8 [frame, height, width, 3].

    Not imageio_ffmpeg's reader: it leaves its pipes open if ffmpeg ends before it is closed.
    """
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(),
        "-i",
        f"file:{path}",  # a colon in a name ends no protocol
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-fps_mode",
        "passthrough",
        "-",
    ]
    process = subprocess.run(command, capture_output=True, check=True)
    size = re.search(rb"Video:.*? (\d+)x(\d+)[ ,]", process.stderr)
    assert size, f"{path} is no video"
    width, height = map(int, size.groups())
    return np.frombuffer(process.stdout, np.uint8).reshape(-1, height, width, 3)
