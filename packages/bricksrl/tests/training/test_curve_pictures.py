"""What a learning curve shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex

from bricksrl import plotting
from bricksrl.errors import DescriptionError
from bricksrl.plotting import GREY, LIGHT, PALETTE, STRONG, check_picture, finish, new_figure, style
from bricksrl.training import Episode, Phase
from bricksrl.training import curve as curves
from bricksrl.training.curve import draw_learning_curve, moving_mean


@given(st.lists(st.integers(-1000, 1000), max_size=12), st.integers(1, 5))
def test_moving_mean_is_of_the_last_values(values: list[int], window: int) -> None:
    means = moving_mean(values, window)
    assert len(means) == len(values)
    for place, mean in enumerate(means):
        recent = values[max(0, place + 1 - window) : place + 1]
        assert mean == pytest.approx(float(np.mean(recent)))


def episodes(count: int, random: int = 0) -> list[Episode]:
    """Episodes with returns 10, 20, ..., of which the first ones are random."""
    made = []
    for number in range(1, count + 1):
        phase = Phase.PREFILL if number <= random else Phase.TRAIN
        made.append(Episode(number, phase, number, 1, 10.0 * number, None))
    return made


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures that are drawn, and not written."""
    figures: list[Any] = []
    monkeypatch.setattr(curves, "save", lambda figure, path: figures.append(figure))
    return figures


def test_curve_has_dots_their_mean_and_evaluations(drawn: list[Any]) -> None:
    shown = episodes(7, random=2)
    shown[3] = replace(shown[3], evaluation=99.0)
    shown[6] = replace(shown[6], evaluation=0.0)
    draw_learning_curve(Path("a.png"), shown, "Walker-v0 · sac", {"random": -5.0})
    (axes,) = drawn[0].axes
    random, learned, mean, evaluations, reference = axes.lines
    assert list(random.get_xdata()) == [1, 2] and list(random.get_ydata()) == [10.0, 20.0]
    assert list(learned.get_xdata()) == [3, 4, 5, 6, 7]
    assert list(learned.get_ydata()) == [30.0, 40.0, 50.0, 60.0, 70.0]
    assert list(mean.get_xdata()) == [1, 2, 3, 4, 5, 6, 7]
    assert list(mean.get_ydata()) == [10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0]
    assert list(evaluations.get_xdata()) == [4, 7] and list(evaluations.get_ydata()) == [99.0, 0.0]
    assert list(reference.get_ydata()) == [-5.0, -5.0]
    assert [line.get_marker() for line in axes.lines[:4]] == ["o", "o", "None", "D"]
    assert random.get_linestyle() == learned.get_linestyle() == "None"
    colours = [to_hex(line.get_color()) for line in axes.lines[:4]]
    assert colours == [GREY, LIGHT, STRONG, PALETTE[1]]
    layers = [line.get_zorder() for line in (reference, random, mean, evaluations)]
    assert layers == sorted(set(layers)), "what matters most lies above"
    (legend,) = drawn[0].legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "random start",
        "episode",
        "mean of the last 5: 50 at the end",
        "evaluation",
    ]
    assert axes.get_title("left") == "Walker-v0 · sac"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("episode", "return (sum of rewards)")


@pytest.mark.parametrize(
    ("count", "random", "labels"),
    [
        (0, 0, []),
        (1, 0, ["episode"]),
        (1, 1, ["random start"]),
        (3, 0, ["episode", "mean of the last 3: 20 at the end"]),
    ],
)
def test_legend_names_only_what_is_there(
    drawn: list[Any], count: int, random: int, labels: list[str]
) -> None:
    draw_learning_curve(Path("a.png"), episodes(count, random), "title")
    texts = [text.get_text() for legend in drawn[0].legends for text in legend.get_texts()]
    assert texts == labels


def texts_of(lines: dict[str, float], low: float, high: float) -> list[tuple[str, float]]:
    """Labels at the right edge, and how high they are, from 0 to 1."""
    axes = new_figure().subplots()
    axes.plot([1, 2], [low, high])
    axes.set_ylim(low, high)
    finish(axes, lines)
    assert all(text.xy[0] == 1.0 for text in axes.texts)
    return [(text.get_text(), float(text.xy[1])) for text in axes.texts]


def test_reference_lines_are_named_where_they_are() -> None:
    found = texts_of({"high": 75.0, "low": 25.0}, 0.0, 100.0)
    assert found == [("low 25", pytest.approx(0.25)), ("high 75", pytest.approx(0.75))]


def test_names_of_close_lines_are_spread() -> None:
    found = texts_of({"a": 50.0, "b": 51.0, "c": 52.0, "d": 90.0}, 0.0, 100.0)
    heights = [height for _, height in found]
    assert [text for text, _ in found] == ["a 50", "b 51", "c 52", "d 90"]
    assert heights[0] == pytest.approx(0.5) and heights[3] == pytest.approx(0.9)
    gaps = np.diff(heights[:3])
    assert gaps.min() == pytest.approx(gaps.max()) and 0.04 < gaps[0] < 0.1


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (99.96, "100"),
        (100.0, "100"),
        (-100.4, "-100"),
        (99.4, "99.4"),
        (999_999_999.0, "999,999,999"),
        (1e9, "1.00e+09"),
        (-2.5e10, "-2.50e+10"),
        (0.0, "0"),
    ],
)
def test_numbers_have_three_digits_and_no_exponent(value: float, text: str) -> None:
    assert plotting.number(value) == text


@pytest.mark.parametrize("name", ["a.png", "a.SVG", "b.c.pdf"])
def test_pictures_are_of_three_kinds(name: str) -> None:
    assert check_picture(name) == Path(name)


@pytest.mark.parametrize("name", ["a.gif", "png", "a.png.txt"])
def test_other_names_are_no_pictures(name: str) -> None:
    with pytest.raises(DescriptionError) as raised:
        check_picture(name)
    assert str(raised.value) == (f"'{name}' is not a name of a picture; end it in .png, .svg, .pdf")


def test_figures_have_their_size_and_a_light_frame(tmp_path: Path) -> None:
    assert tuple(new_figure().get_size_inches()) == (8.0, 4.5)
    figure = new_figure(4.0, 2.0)
    axes = figure.subplots()
    style(axes, "Returns", "episode", "return")
    assert axes.get_title("left") == "Returns"
    assert [axes.spines[side].get_visible() for side in ("top", "right", "left", "bottom")] == [
        False,
        False,
        False,
        True,
    ]
    plotting.save(figure, tmp_path / "a.png", dots_per_inch=50)
    image = plotting_image(tmp_path / "a.png")
    assert image.shape[:2] == (100, 200)
    plotting.save(figure, tmp_path / "b.PNG")
    assert plotting_image(tmp_path / "b.PNG").shape[:2] == (300, 600)


def plotting_image(path: Path) -> Any:
    from matplotlib.image import imread

    return imread(path, format="png")


def test_image_is_written_as_it_is(tmp_path: Path) -> None:
    image = np.arange(4 * 5 * 3, dtype=np.uint8).reshape(4, 5, 3)
    plotting.save_image(str(tmp_path / "a.png"), image)
    read = np.rint(255 * plotting_image(tmp_path / "a.png")[..., :3]).astype(np.uint8)
    assert (read == image).all()
