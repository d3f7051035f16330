"""GIFs of robots before and after learning, for the README, from the films of runs.

    bricksrl train Walker-v1 --episodes 20 --seed 0 --run runs/walker
    python -m benchmarks moving_pictures runs/walker

Writes ``docs/images/<environment>_learning.gif``, with as many pixels and colours as fit into a megabyte. A film may be given
instead of a run.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image

from benchmarks.session import Session
from bricksrl.training import RunFolder

FOLDER = Path(__file__).parents[1] / "docs" / "images"
MAX_BYTES = 1_000_000
SIZES = ((640, 96), (560, 64), (480, 48), (400, 32), (320, 24), (256, 16))
"""Width in px and number of colours, the best first."""
FPS, LONGEST_S = 6.0, 9.0


def frames(video: Path) -> Iterator[Image.Image]:
    """Images of a film, :data:`FPS` per second, of its first :data:`LONGEST_S` seconds."""
    reader = imageio_ffmpeg.read_frames(str(video))
    video_info = next(reader)
    width, height = video_info["size"]
    step = video_info["fps"] / FPS
    for number, frame in enumerate(reader):
        if number >= LONGEST_S * video_info["fps"]:
            break
        if int(number / step) != int((number - 1) / step) or number == 0:
            yield Image.fromarray(np.frombuffer(frame, np.uint8).reshape(height, width, 3))
    reader.close()


def _palette(picture: Image.Image, colours: int) -> Image.Image:
    """An image with the best palette for a picture, in which rare colours have more weight than their area."""
    colours_found, counts = np.unique(np.asarray(picture).reshape(-1, 3) >> 2, axis=0, return_counts=True)
    pixels = np.repeat(colours_found << 2, np.ceil(counts**0.5).astype(int), axis=0)
    return Image.fromarray(pixels[None].astype(np.uint8)).quantize(colours, dither=Image.Dither.NONE, kmeans=2)


def gif(pictures: list[Image.Image], width: int, colours: int) -> bytes:
    """An endless GIF with one palette for all images, so that unchanged pixels cost nothing."""
    small = [image.resize((width, round(width * image.height / image.width)), Image.Resampling.LANCZOS) for image in pictures]
    palette = _palette(small[len(small) // 2], colours)
    flat = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in small]
    data = io.BytesIO()
    flat[0].save(data, "GIF", save_all=True, append_images=flat[1:], duration=round(1000 / FPS), loop=0, optimize=True)
    return data.getvalue()


def main(session: Session) -> None:
    parser = session.parser
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a run that was filmed, or a film")
    for run in session.parse().runs:
        is_film = run.suffix == ".mp4"
        pictures = list(frames(run if is_film else run / "before_after.mp4"))
        name = run.stem if is_film else f"{RunFolder(run).read_config().env.lower().replace('-', '_')}_learning"
        for width, colours in SIZES:
            data = gif(pictures, width, colours)
            if len(data) < MAX_BYTES:
                break
        path = session.place_of(FOLDER) / f"{name}.gif"
        path.write_bytes(data)
        print(f"{path}: {len(data) / 1000:.0f} kB, {width} px wide, {colours} colours, {len(pictures)} pictures")
