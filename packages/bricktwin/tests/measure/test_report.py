"""Report of a measuring session: what its table says and where its plots draw each number."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bricktwin.measure import report
from bricktwin.measure.report import lines, write_report
from bricktwin.measure.results import Comparison, Quantity
from bricktwin.measure.session import Row, SessionLog
from bricktwin.twin.physics import PARAMETERS, Physics

DRIFT = Quantity("drift", "deg/min", "gyro_drift_deg_min")
SPEED = Quantity("speed", "deg/s", "motor_1_scale", None)
PITCH = Quantity("pitch", "deg", "acceleration_bias_x_mm_s2", -0.5)
WALL = Quantity("wall aslant", "mm")
ALONE = Quantity("of the robot alone", "ms", "link_interval_ms", 2.0)
UNSEEN = Quantity("unseen", "ms", "link_interval_ms", 2.0)


def comparison(robot: dict[str, float], twin: dict[str, float]) -> Comparison:
    return Comparison((DRIFT, SPEED, PITCH, WALL, ALONE, UNSEEN), robot, twin, Physics())


def ends(parameter: str) -> tuple[float, float, float]:
    """Lowest, nominal and highest value of a parameter."""
    low, high = PARAMETERS[parameter].random_range
    return low, float(getattr(Physics(), parameter)), high


ROWS = tuple(Row("rest", 20 * number, 10.0 + number % 3, {}) for number in range(9))
TWIN = {"drift": 0.0, "speed": 1000.0, "pitch": 0.0, "wall aslant": 250.0, "unseen": 4.0}


def test_each_number_stands_beside_its_twin_and_the_drawn_twins() -> None:
    low, nominal, high = ends("gyro_drift_deg_min")
    drift = (low + high) / 2
    robot = {"drift": drift, "speed": 900.0, "wall aslant": 251.5, "of the robot alone": 7.0}
    rows = {name: rest for name, *rest in lines(comparison(robot, TWIN))}
    # Only what the robot has is told, in the order of the quantities.
    assert list(rows) == [
        "drift, deg/min",
        "speed, deg/s",
        "wall aslant, mm",
        "of the robot alone, ms",
    ]
    text = report.plain_number
    start = float(Physics().gyro_drift_deg_min)
    assert rows["drift, deg/min"] == [
        text(drift),
        text(nominal - start),
        f"{text(low - start)} to {text(high - start)}",
        "",
    ]
    # What is in proportion to its parameter is scaled by it.
    low, nominal, high = ends("motor_1_scale")
    assert rows["speed, deg/s"][:3] == ["900", "1000", f"{text(1000 * low)} to {text(1000 * high)}"]
    # Without a parameter nothing is drawn, and without a twin it stands alone.
    assert rows["wall aslant, mm"] == ["251.5", "250", "", ""]
    assert rows["of the robot alone, ms"] == ["7", "", "", ""]


@pytest.mark.parametrize(
    ("share", "is_outside"), [(-0.01, True), (0.0, False), (1.0, False), (1.01, True)]
)
def test_a_number_that_no_drawn_twin_has_is_remarked(share: float, is_outside: bool) -> None:
    made = comparison({"speed": 0.0}, TWIN)
    low, _, high = made.scale(SPEED)
    value = low + share * (high - low) if share not in (0.0, 1.0) else (low, high)[int(share)]
    ((*_, remark),) = lines(comparison({"speed": value}, TWIN))
    assert remark == ("outside of what --randomize draws (motor_1_scale)" if is_outside else "")


def test_a_scale_goes_up_where_its_number_goes_down_with_its_parameter() -> None:
    low, nominal, high = comparison({}, TWIN).scale(PITCH)
    assert low < nominal < high
    bottom, middle, top = ends("acceleration_bias_x_mm_s2")
    assert (low, high) == pytest.approx((-0.5 * (top - middle), -0.5 * (bottom - middle)))


def drawn(robot: dict[str, float]) -> Axes:
    axes: Axes = Figure().subplots()
    report._draw_ranges(axes, comparison(robot, TWIN))
    return axes


def places(axes: Axes, marker: str) -> Sequence[tuple[float, float]]:
    """Places of all marks of a kind."""
    lines = [line for line in axes.lines if line.get_marker() == marker]
    return [(float(line.get_xdata()[0]), float(line.get_ydata()[0])) for line in lines]  # type: ignore[index]


def test_numbers_are_drawn_on_a_scale_from_the_lowest_to_the_highest_twin() -> None:
    made = comparison({}, TWIN)
    low, nominal, high = made.scale(SPEED)
    quarter = low + 0.25 * (high - low)
    middle = sum(made.scale(DRIFT)[::2]) / 2
    robot = {"speed": quarter, "drift": middle, "wall aslant": 3.0, "of the robot alone": 1.0}
    axes = drawn(robot)
    # Those without a parameter or a twin are not drawn; the others are rows from above.
    assert [label.get_text() for label in axes.get_yticklabels()] == ["drift", "speed"]
    assert axes.yaxis_inverted() and list(axes.get_yticks()) == [0, 1]
    assert places(axes, "o") == [
        (pytest.approx(0.5), 0.0),
        (pytest.approx(0.25), 1.0),
    ]
    assert places(axes, "|")[1] == (pytest.approx((nominal - low) / (high - low)), 1.0)
    bars = [line for line in axes.lines if len(line.get_xdata()) == 2]  # type: ignore[arg-type]
    assert [list(bar.get_xdata()) for bar in bars] == [[0, 1], [0, 1]]  # type: ignore[arg-type]
    assert [list(bar.get_ydata()) for bar in bars] == [[0, 0], [1, 1]]  # type: ignore[arg-type]
    # The ends are written below each bar, the right one with its unit.
    texts = {text.get_text(): text for text in axes.texts}
    left, right = texts[report.plain_number(low, 3)], texts[f"{report.plain_number(high, 3)} deg/s"]
    assert left.get_position() == (0.0, 1.2) and right.get_position() == (1.0, 1.2)
    assert (left.get_ha(), right.get_ha()) == ("left", "right")
    assert left.get_va() == right.get_va() == "top"
    # All of it is in sight, what is far outside too; shares have no numbers.
    assert axes.get_xlim() == (-0.35, 1.35) and list(axes.get_xticks()) == []


@pytest.mark.parametrize(("share", "place"), [(-5.0, -0.3), (-0.2, -0.2), (1.2, 1.2), (9.0, 1.3)])
def test_a_number_far_outside_is_drawn_at_the_edge(share: float, place: float) -> None:
    low, _, high = comparison({}, TWIN).scale(SPEED)
    ((x, _),) = places(drawn({"speed": low + share * (high - low)}), "o")
    assert x == pytest.approx(place)


def test_the_page_has_title_table_and_plots(tmp_path: Path) -> None:
    log = SessionLog("<rover>", {"hub": "a & b", "day": "today"}, ROWS)
    write_report(tmp_path / "report.html", log, comparison({"wall aslant": 3.0}, TWIN))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<title>&lt;rover&gt;, measured</title>" in page
    assert "<h1>&lt;rover&gt;, measured</h1>\n<p class=who>hub a &amp; b, day today</p>" in page
    head = "<tr><th></th><th>robot</th><th>twin</th><th>drawn twins</th><th></th></tr>"
    row = "<tr><td>wall aslant, mm</td><td>3</td><td>250</td><td></td><td></td></tr>"
    assert f"<table class=numbers>{head}{row}</table>" in page
    # The plot is a part of the page.
    assert page.count("<svg") == 1 and "<?xml" not in page
    for text in ("time of an exchange", "exchanges", "robot (dot), twin (line), drawn twins (bar)"):
        assert f"<!-- {text} -->" in page, text
