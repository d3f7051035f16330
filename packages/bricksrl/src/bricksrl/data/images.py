"""Images of an episode as a lossless video: H.264 in RGB."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bricksrl.data.parquet import RESTORE
from bricksrl.errors import DataError

_QUIET = ("-hide_banner", "-loglevel", "error", "-nostdin")
_LOSSLESS = ("-c:v", "libx264rgb", "-crf", "0", "-preset", "veryfast", "-g", "2", "-movflags", "+faststart")
_ONE_MP4_FILE = ("-protocol_whitelist", "file", "-f", "mp4")  # a disguised playlist could name other files and servers


def encode(images: NDArray[np.uint8], rate_hz: float) -> bytes:
    """Encode images ``[steps, height, width, 3]`` losslessly as an mp4 file, the inverse of `decode`. Raises DataError if ffmpeg
    is not installed, or it failed."""
    _, height, width, _ = images.shape
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate_hz), "-i", "pipe:0")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        command = [_ffmpeg(), *_QUIET[:-1], *raw, *_LOSSLESS, str(path)]
        process = subprocess.run(command, input=images.tobytes(), capture_output=True, check=False)  # noqa: S603
        if process.returncode:
            raise DataError(f"ffmpeg could not write a video: {process.stderr.decode(errors='replace').strip()}; install another")
        return path.read_bytes()


def decode(path: Path, count: int, side: int) -> NDArray[np.uint8]:
    """Decode the first ``count`` images of a file, ``[count, side, side, 3]``. Raises DataError if the file is no such video, or
    too short."""
    size_bytes = count * side * side * 3
    raw = ("-frames:v", str(count), "-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1")
    command = [_ffmpeg(), *_QUIET, *_ONE_MP4_FILE, "-i", f"file:{path}", *raw]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:  # noqa: S603
        data = b"" if process.stdout is None else process.stdout.read(size_bytes + 1)
        process.kill()
    if len(data) != size_bytes:
        raise DataError(f"{path} is not a video of {count} images of {side} x {side} px; {RESTORE}")
    return np.frombuffer(data, np.uint8).reshape(count, side, side, 3)


def _ffmpeg() -> str:
    import imageio_ffmpeg

    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError:
        raise DataError("there is no ffmpeg for videos; reinstall imageio-ffmpeg: pip install imageio-ffmpeg") from None
