"""Calibration of red: the colours of a ball for this camera and light, estimated from a frame and
kept in a file."""

import dataclasses
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brickhub.files import reading, write_durably
from brickhub.hub.diagnostics.calibration import calibration_folder
from bricksrl.envs.vision.frames import Frame, Place, RedWindow
from bricksrl.errors import CameraError

_AROUND_RED_DEG = 60.0
"""Hues within this distance of 0 have red as the strongest channel."""
_LEAST_CHROMA = 0.12
"""Saturation times value; below it the hue is unreliable."""
_LEAST_PX = 5
"""Fewer red pixels are sensor noise."""
_SEED_PX = 50
"""Rank of the pixel whose chroma sets the threshold for seeds."""
_POINT_PX = 3
"""Half side of the square around a given point whose colour is taken."""
# Spread of one object's colour around its median: darker in shade, less saturated in highlights.
_UNLIKE_HUE_DEG = 30.0
_LEAST_SATURATION_RATIO = 0.5
_LEAST_VALUE_RATIO = 0.35
# What the window leaves around the colours that were seen.
_MARGIN_DEG = 8.0
_MARGIN = 0.8


@dataclass(frozen=True)
class FoundRed:
    """Window of red fitted to an object, and the object's mask: bool ``[height, width]``."""

    window: RedWindow
    mask: NDArray[np.bool_]

    @property
    def middle(self) -> Place:
        """Centroid of the object, in px."""
        rows, columns = np.nonzero(self.mask)
        return round(float(columns.mean())), round(float(rows.mean()))


def calibrate_red(frame: Frame, at: Place | None = None) -> FoundRed:
    """Find the red object in a frame, and the HSV window that holds its colours with a margin.
    Raises CameraError if nothing is red, at that point or anywhere, or the object is too small.

    Args:
        frame: uint8 ``[height, width, 3]``.
        at: a point of the object; by default it is the largest of the most strongly red regions.
    """
    hue_deg, saturation, value = _colours(frame)  # [height, width] each
    is_around_red = np.abs(hue_deg) <= _AROUND_RED_DEG
    chroma = np.where(is_around_red, saturation * value, 0.0)
    seed = _most_vivid(chroma) if at is None else _around(frame, at)
    if seed.sum() < _LEAST_PX or np.median(chroma[seed]) < _LEAST_CHROMA:
        place = "the frame" if at is None else f"the frame at {at[0]}, {at[1]}"
        raise CameraError(
            f"nothing is red in {place}; bring the ball into the picture, give it light, or name "
            "a point of it"
        )
    # From the surest pixels to the whole object: all that are connected to them and look alike.
    seed_hue_deg = float(np.median(hue_deg[seed]))
    seed_saturation = float(np.median(saturation[seed]))
    seed_value = float(np.median(value[seed]))
    is_alike = chroma > 0
    is_alike &= np.abs(hue_deg - seed_hue_deg) <= _UNLIKE_HUE_DEG
    is_alike &= saturation >= _LEAST_SATURATION_RATIO * seed_saturation
    is_alike &= value >= _LEAST_VALUE_RATIO * seed_value
    mask = _region(is_alike, seed)  # around a point near its edge, the object's colours only
    if mask.sum() <= RedWindow.area_px:
        raise CameraError(
            f"the red thing has only {mask.sum()} px; bring it nearer to the camera, or name a "
            "point of the ball"
        )
    window = _window_of(hue_deg[mask], saturation[mask], value[mask])
    return FoundRed(window, mask)


def _around(frame: Frame, at: Place) -> NDArray[np.bool_]:
    """The square around a point; ``[height, width]``."""
    rows, columns = np.ogrid[: frame.shape[0], : frame.shape[1]]
    is_row = np.abs(rows - at[1]) <= _POINT_PX
    is_column = np.abs(columns - at[0]) <= _POINT_PX
    square: NDArray[np.bool_] = is_row & is_column
    return square


def _most_vivid(chroma: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The largest region of nearly the strongest chroma; ``[height, width]``."""
    # Not the strongest pixel sets the threshold, which may be noise, but one of a later rank.
    count = min(_SEED_PX, chroma.size)
    strong = float(np.partition(chroma, -count, axis=None)[-count])
    vivid = chroma >= max(0.75 * strong, _LEAST_CHROMA)
    return _region(vivid, vivid)


def _window_of(
    hue_deg: NDArray[np.float64],
    saturation: NDArray[np.float64],
    value: NDArray[np.float64],
) -> RedWindow:
    """The window that holds the colours ``[pixels]`` of an object with a margin."""
    # Percentiles, as a few pixels at the edge mix with the background.
    low_deg, high_deg = np.percentile(hue_deg, (1, 99)).tolist()
    least_saturation = float(np.percentile(saturation, 2))
    least_value = float(np.percentile(value, 2))
    # Beyond these hues another channel than red is the strongest.
    lowest_deg = max(low_deg - _MARGIN_DEG, -_AROUND_RED_DEG)
    highest_deg = min(high_deg + _MARGIN_DEG, _AROUND_RED_DEG)
    return RedWindow(
        hue_deg=(round(lowest_deg, 1), round(highest_deg, 1)),
        saturation=round(_MARGIN * least_saturation, 3),
        value=round(_MARGIN * least_value, 3),
    )


def _colours(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Hue (-60..60 degrees where red is the strongest, else 180), saturation and value (0..1);
    ``[height, width]`` each."""
    shares = frame.astype(np.float64) / 255  # [height, width, 3]
    red, green, blue = np.moveaxis(shares, -1, 0)
    value = frame.max(-1) / 255
    least = frame.min(-1) / 255
    chroma = value - least
    # Grey has no hue and black no saturation; their divisors of 0 are replaced.
    safe_chroma = np.where(chroma > 0, chroma, 1.0)
    safe_value = np.where(value > 0, value, 1.0)
    is_reddish = (red == value) & (chroma > 0)
    # The hue of HSV where red is the strongest channel.
    red_hue_deg = 60.0 * (green - blue) / safe_chroma
    hue_deg = np.where(is_reddish, red_hue_deg, 180.0)
    saturation = chroma / safe_value
    return hue_deg, saturation, value


def _region(mask: NDArray[np.bool_], seed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The connected component of the mask that holds most of the seed."""
    from scipy import ndimage

    neighbours = np.ones((3, 3))  # pixels that touch at a corner belong together
    labels, _ = ndimage.label(mask, neighbours)  # [height, width], 0 outside of the mask
    # Pixels of the seed in each component; two entries at least, so that 0 can be left out.
    counts = np.bincount(labels[seed & mask], minlength=2)
    counts[0] = 0
    if not counts.any():
        return np.zeros_like(mask)
    region: NDArray[np.bool_] = labels == int(counts.argmax())
    return region


def spanning(windows: list[RedWindow]) -> RedWindow:
    """The smallest window that contains all of these."""
    low_deg = min(window.hue_deg[0] for window in windows)
    high_deg = max(window.hue_deg[1] for window in windows)
    saturation = min(window.saturation for window in windows)
    value = min(window.value for window in windows)
    return RedWindow((low_deg, high_deg), saturation, value)


def picture(frame: Frame, found: FoundRed) -> Frame:
    """The frame with the object outlined and, beside it, dimmed outside of the window; ``[height, 2
    width, 3]``."""
    from scipy import ndimage

    outlined = frame.copy()
    wider = ndimage.binary_dilation(found.mask, iterations=2)
    outline = wider & ~found.mask
    outlined[outline] = (0, 255, 0)

    window = found.window
    low_deg, high_deg = window.hue_deg
    hue_deg, saturation, value = _colours(frame)
    is_inside = (hue_deg >= low_deg) & (hue_deg <= high_deg)
    is_inside &= saturation >= window.saturation
    is_inside &= value >= window.value
    dimmed = frame // 5
    dimmed[is_inside] = frame[is_inside]
    return np.hstack((outlined, dimmed))


# ---------------------------------------------------------------- files


def saved_path(device: int | str) -> Path:
    """Path of a camera's calibration, in the folder of the robots' calibrations."""
    # A device may be a URL or a path, whose signs no file name has.
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", str(device))
    return calibration_folder() / f"camera-{name}.json"


def write_red(path: Path, window: RedWindow) -> None:
    """Write a window atomically. Raises WriteError if the file cannot be written."""
    text = json.dumps({"red": dataclasses.asdict(window)}, indent=2)
    write_durably(path, f"{text}\n".encode())


def read_red(path: Path) -> RedWindow:
    """Read the window that `write_red` wrote. Raises CameraError if the file is missing or
    invalid."""
    with reading(
        "the calibration",
        path,
        CameraError,
        "make one with `bricksrl camera calibrate`",
    ):
        data: dict[str, Any] = json.loads(path.read_bytes())["red"]
        low, high = map(float, data["hue_deg"])
        return RedWindow(
            (low, high),
            float(data["saturation"]),
            float(data["value"]),
            int(data["area_px"]),
        )


def saved_red(device: int | str) -> RedWindow | None:
    """The saved window of this camera; ``None`` if there is none. Raises CameraError if the file is
    invalid."""
    path = saved_path(device)
    return read_red(path) if path.exists() else None
