"""Content for late browsers, and bounded memory."""

from __future__ import annotations

import json
import struct

import numpy as np

from brickhub.entry import Entry
from bricksrl.page.board import IMAGE, POSES, Board, BoardReader, Series, to_json
from bricksrl.page.live import PageDriver, stick_map
from bricktwin.view.drawing_of_body import Drawing, DrawnBody, Shape, box, poses


def test_reader_gets_snapshot_then_changes() -> None:
    board = Board()
    drawing = Drawing((DrawnBody("cube", (Shape(box((1.0, 1.0, 1.0)), (1.0, 0.0, 0.0, 1.0)),)),))
    board.show_drawing(drawing, poses([[0, 0, 1]]))
    board.update_status(state="running")
    series = board.new_series("reward", ("reward",))
    series.add((0.5,))
    reader = BoardReader(board)
    news = reader.changes(numbers=True)
    assert (
        news[0] == {"drawing": 1}
        and news[1][0] == POSES
        and news[2] == {"status": {"state": "running"}}
    )
    assert news[3] == {
        "series": {"reward": {"first": 0, "rows": [[0.5]], "names": ("reward",), "kept": 400}}
    }
    assert reader.changes(numbers=True) == []
    series.add((0.25,))
    board.update_status(state="running")
    assert reader.changes(numbers=False) == []
    assert reader.changes(numbers=True) == [{"series": {"reward": {"first": 1, "rows": [[0.25]]}}}]
    board.show_poses(lambda: poses([[0, 0, 2]]))
    (moved,) = reader.changes(numbers=False)
    assert struct.unpack("<7f", moved[4:])[:3] == (0, 0, 2)
    assert [type(one) for one in BoardReader(board).changes(numbers=True)] == [
        dict,
        bytes,
        dict,
        dict,
    ]


def test_board_image() -> None:
    board = Board()
    board.show_image(np.arange(24, dtype=np.uint8).reshape(2, 4, 3))
    message = BoardReader(board).changes(numbers=True)[0]
    assert struct.unpack_from("<BxHH", message) == (IMAGE, 2, 4) and message[8:] == bytes(range(24))


def test_late_reader_gets_bounded_series() -> None:
    board = Board()
    series = board.new_series("return", ("return",), max_rows=5)
    reader = BoardReader(board)
    reader.changes(numbers=True)
    for value in range(12):
        series.add((value,))
    assert reader.changes(numbers=True)[-1]["series"]["return"]["first"] == 7
    assert BoardReader(board).changes(numbers=True)[-1]["series"]["return"]["rows"] == [
        [7.0],
        [8.0],
        [9.0],
        [10.0],
        [11.0],
    ]
    assert Series(("a",)).since(0) == (0, [])


def test_new_series_replaces_same_name() -> None:
    board = Board()
    board.new_series("channels", ("a",)).add((1.0,))
    reader = BoardReader(board)
    reader.changes(numbers=True)
    board.new_series("channels", ("a", "b")).add((1.0, 2.0))
    told = reader.changes(numbers=True)[-1]["series"]["channels"]
    assert told["names"] == ("a", "b") and told["rows"] == [[1.0, 2.0]]
    json.dumps(told)


LEGS = [
    Entry(f"{side}_{end}", -100.0, 0.0, "deg")
    for end in ("front", "back")
    for side in ("left", "right")
]


def test_driver_covers_full_range(monkeypatch) -> None:
    driver = PageDriver(LEGS, in_charge=True)
    assert driver(None).tolist() == [1.0] * 4 and driver.actions() == [0.0] * 4, (
        "legs at rest: nothing turns"
    )
    assert driver.push([-1, -0.5, 0, 1])
    assert driver.actions() == [-100.0, -50.0, 0.0, 0.0]
    for bad in (
        None,
        [1, 2],
        [1, 2, 3, float("nan")],
        ["a"] * 4,
        {"a": 1},
        [None] * 4,
        [10**400] * 4,
    ):
        assert not driver.push(bad)
    assert driver.pushes == [-1.0, -0.5, 0.0, 1.0]
    monkeypatch.setattr("bricksrl.page.live.PUSH_TIMEOUT_S", -1.0)
    assert driver.pushes == [0.0] * 4, "who is silent for too long has gone"
    driver.in_charge = False
    assert driver(None) is None


def test_driver_stick() -> None:
    assert stick_map(LEGS) == [[-1.0, -1.0], [1.0, -1.0], [-1.0, -1.0], [1.0, -1.0]]
    wheels = [Entry("left", -90.0, 90.0, "deg"), Entry("right", -90.0, 90.0, "deg")]
    assert stick_map(wheels) == [[1.0, 1.0], [-1.0, 1.0]]
    assert stick_map([Entry("drive", -1.0, 1.0)]) == [[0.0, 1.0]]
    drive = [Entry("drive_speed", -100.0, 100.0, "mm/s"), Entry("turn_rate", -60.0, 60.0, "deg/s")]
    assert stick_map(drive) == [[0.0, 1.0], [1.0, 0.0]] and stick_map(drive[::-1]) == [
        [1.0, 0.0],
        [0.0, 1.0],
    ]
    arm = [Entry(name, -1.0, 1.0) for name in ("rotation", "low", "high", "grab")]
    assert stick_map(arm) == [[-1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], (
        "an arm to the right, seen from behind"
    )


def test_numbers_that_json_lacks_are_null() -> None:
    board = Board()
    board.update_status(facts={"reward": float("nan"), "episode": "1/2"})
    board.new_series("reward", ("reward",)).add((float("inf"),))
    status, series = (
        json.loads(to_json(message), parse_constant=float)
        for message in BoardReader(board).changes(numbers=True)
    )
    assert status == {"status": {"facts": {"reward": None, "episode": "1/2"}}}
    assert series["series"]["reward"]["rows"] == [[None]]
