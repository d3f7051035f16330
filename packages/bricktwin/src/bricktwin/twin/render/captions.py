"""Captions of videos: a title, a line of numbers, and labels, drawn onto images with Pillow."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bricktwin.drawing import import_matplotlib

Pixels = NDArray[np.uint8]
_INK, _MUTED, _BACKGROUND, _OPACITY = (31, 36, 48), (73, 81, 94), (255, 255, 255), 205


@functools.lru_cache(maxsize=8)
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, from Matplotlib's data."""
    import_matplotlib()
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size_px)


def captioned(image: Pixels, title: str, line: str, labels: Iterable[tuple[int, int, str]] = ()) -> Pixels:
    """The image ``[height, width, 3]`` with title and line in its upper left corner, and labels (column, row, text)."""
    height = image.shape[0]
    large, small = max(11, height // 26), max(9, height // 34)
    picture = Image.fromarray(image)
    pen = ImageDraw.Draw(picture)
    for column, row, text in labels:
        pen.text((column, row), text, _MUTED, _font(small, False), anchor="mm")
    lines = [(text, _font(size, bold)) for text, size, bold in ((title, large, True), (line, small, False)) if text]
    if lines:
        margin = height // 45
        width = 2 * margin + round(max(pen.textlength(text, font) for text, font in lines))
        box_height = 2 * margin + round(sum(font.size for _, font in lines)) + margin // 2 * (len(lines) - 1)
        # Only the area behind the text is blended: the whole image would take longer than drawing the robot.
        mask = Image.new("L", (width, box_height), 0)
        ImageDraw.Draw(mask).rounded_rectangle((0, 0, width - 1, box_height - 1), margin // 2, _OPACITY)
        picture.paste(_BACKGROUND, (margin, margin, margin + width, margin + box_height), mask)
        top = 2.0 * margin
        for text, font in lines:
            pen.text((2 * margin, top), text, _INK, font)
            top += font.size + margin // 2
    return np.asarray(picture)
