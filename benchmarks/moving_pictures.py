"""GIFs of robots, for the documentation: before and after learning, from the films of runs, and of
each environment.

    bricksrl train Walker-v1 --episodes 20 --seed 0 --run runs/walker
    python -m benchmarks moving_pictures runs/walker
    python -m benchmarks moving_pictures Walker-v1 Park-v0

Writes ``docs/images/<environment>_learning.gif`` of a run, with as many pixels and colours as fit
into a megabyte, and ``docs/images/<environment>.gif`` of an environment, with those that fit into
400 kB: the first seconds of an episode of the policy that comes with it, or of its controller. A
film may be given instead of a run.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np
import torch
from PIL import Image

import bricksrl
from benchmarks.session import Session
from bricksrl.evaluation.film import filmed_env
from bricksrl.policies.by_name import array_policies
from bricksrl.training import RunFolder

if TYPE_CHECKING:
    from tensordict import TensorDictBase

FOLDER = Path(__file__).parents[1] / "docs" / "images"
MAX_BYTES, ENV_MAX_BYTES = 1_000_000, 400_000
SIZES = ((640, 96), (560, 64), (480, 48), (400, 32), (320, 24), (256, 16))
"""Width in px and number of colours, the best first."""
EPISODES = {"RoboArm-v0": 3, "RoboArm_mixed-v0": 3}
"""Of an environment, where one is short."""
FPS, LONGEST_S, ENV_LONGEST_S = 6.0, 9.0, 6.0


def frames(video: Path, longest_s: float) -> Iterator[Image.Image]:
    """Images of a film, :data:`FPS` per second, of its first ``longest_s`` seconds."""
    reader = imageio_ffmpeg.read_frames(str(video))
    video_info = next(reader)
    width, height = video_info["size"]
    step = video_info["fps"] / FPS
    for number, frame in enumerate(reader):
        if number >= longest_s * video_info["fps"]:
            break
        if int(number / step) != int((number - 1) / step) or number == 0:
            yield Image.fromarray(np.frombuffer(frame, np.uint8).reshape(height, width, 3))
    reader.close()


def _palette(picture: Image.Image, colours: int) -> Image.Image:
    """An image with the best palette for a picture, in which rare colours have more weight than
    their area."""
    colours_found, counts = np.unique(
        np.asarray(picture).reshape(-1, 3) >> 2, axis=0, return_counts=True
    )
    pixels = np.repeat(colours_found << 2, np.ceil(counts**0.5).astype(int), axis=0)
    return Image.fromarray(pixels[None].astype(np.uint8)).quantize(
        colours, dither=Image.Dither.NONE, kmeans=2
    )


def gif(pictures: list[Image.Image], width: int, colours: int) -> bytes:
    """An endless GIF with one palette for all images, so that unchanged pixels cost nothing."""
    small = [
        image.resize((width, round(width * image.height / image.width)), Image.Resampling.LANCZOS)
        for image in pictures
    ]
    palette = _palette(small[len(small) // 2], colours)
    flat = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in small]
    data = io.BytesIO()
    flat[0].save(
        data,
        "GIF",
        save_all=True,
        append_images=flat[1:],
        duration=round(1000 / FPS),
        loop=0,
        optimize=True,
    )
    return data.getvalue()


def film_env(env_id: str, path: Path) -> list[Image.Image]:
    """Film the best policy that an environment has, and return what it saw by a camera, in each
    step."""
    seen = []
    with closing(bricksrl.make(env_id, seed=0)) as env:
        *_, make_policy = array_policies(env_id, env.task, 0).values()
        policy = make_policy()

        # by its argument TorchRL knows a policy
        def act(tensordict: TensorDictBase) -> TensorDictBase:
            arrays = {
                name: tensordict[name].numpy().copy()
                for name in {"observation", "image"} & set(tensordict.keys())
            }
            if "image" in arrays:
                seen.append(Image.fromarray(arrays["image"]))
            return tensordict.set("action", torch.as_tensor(policy(arrays), dtype=torch.float32))

        with filmed_env(env, path, env_id, size=(640, 360)):
            for _ in range(EPISODES.get(env_id, 1)):
                env.rollout(env.task.max_steps, act)
    return seen


def main(session: Session) -> None:
    parser = session.parser
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="RUN",
        help="folder of a run that was filmed, a film, or an environment",
    )
    for source in session.parse().sources:
        path, most, longest_s, seen = Path(source), MAX_BYTES, LONGEST_S, list[Image.Image]()
        with tempfile.TemporaryDirectory() as folder:
            if source in bricksrl.list_envs():
                name, path = source.lower().replace("-", "_"), Path(folder) / "film.mp4"
                most, longest_s = ENV_MAX_BYTES, ENV_LONGEST_S
                seen = film_env(source, path)
            elif path.suffix == ".mp4":
                name = path.stem
            else:
                name = f"{RunFolder(path).read_config().env.lower().replace('-', '_')}_learning"
                path /= "before_after.mp4"
            pictures = list(frames(path, longest_s))
        for number, picture in enumerate(pictures if seen else ()):
            picture.paste(seen[number * len(seen) // len(pictures)].resize((160, 160)), (470, 190))
        for width, colours in SIZES:
            data = gif(pictures, width, colours)
            if len(data) < most:
                break
        path = session.place_of(FOLDER) / f"{name}.gif"
        path.write_bytes(data)
        print(
            f"{path}: {len(data) / 1000:.0f} kB, {width} px wide, {colours} colours, "
            f"{len(pictures)} pictures",
            flush=True,
        )
