"""Drawings of the start page: what is in the folder, and what was found in it."""

from __future__ import annotations

import json
import os
from pathlib import Path

from bricksrl.page import drawings as shown
from bricksrl.page.drawings import Drawings


def test_what_was_found_in_a_drawing_is_forgotten_when_it_changes(tmp_path: Path) -> None:
    drawing = tmp_path / "mine.ldr"
    drawing.write_text("0 A robot", encoding="utf-8")
    drawings = Drawings(tmp_path)
    can = {"name": "walk", "sentence": "walk forward", "reason": ""}
    cannot = {"name": "park", "sentence": "park in a bay", "reason": "no motor turns a wheel"}
    found = {"abilities": [can, cannot]}
    assert drawings.described() == [{"name": "mine.ldr", "found": None}]
    drawings.take("mine.ldr", ["a warning", json.dumps(found)])
    assert drawings.described() == [{"name": "mine.ldr", "found": found}]
    assert drawings.goals() == ["mine.ldr:walk"]
    changed_s = drawing.stat().st_mtime + 10
    os.utime(drawing, (changed_s, changed_s))
    assert drawings.goals() == []
    drawing.unlink()
    assert drawings.described() == []


def test_latest_drawings_stand_first_and_older_ones_are_left_out(tmp_path: Path) -> None:
    for number in range(shown._MAX_DRAWINGS + 2):
        path = tmp_path / f"{number}.ldr"
        path.write_text("0 A robot", encoding="utf-8")
        os.utime(path, (1000 + number, 1000 + number))
    (tmp_path / "notes.txt").write_text("no drawing")
    (tmp_path / "UPPER.MPD").write_text("0 A robot", encoding="utf-8")
    names = Drawings(tmp_path).names()
    assert len(names) == shown._MAX_DRAWINGS
    assert names[:3] == ["UPPER.MPD", "31.ldr", "30.ldr"] and names[-1] == "3.ldr"
    assert Drawings(tmp_path / "nowhere").names() == []


def test_drawing_that_cannot_be_read_says_why_and_can_learn_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine.ldr").write_text("0 A robot", encoding="utf-8")
    drawings = Drawings(tmp_path)
    drawings.fail("mine.ldr", "line 3 has no part; correct it")
    (said,) = drawings.described()
    assert said["found"] == {"error": "line 3 has no part; correct it", "abilities": []}
    assert drawings.goals() == []
    drawings.take("mine.ldr", ["[1]", "{}", "broken {"])
    assert drawings.described() == [said], "only what tells of abilities is an answer"


def test_look_at_a_drawing_that_is_gone_is_forgotten_with_it(tmp_path: Path) -> None:
    drawing = tmp_path / "mine.ldr"
    drawing.write_text("0 A robot", encoding="utf-8")
    drawings = Drawings(tmp_path)
    drawing.unlink()
    drawings.take("mine.ldr", [json.dumps({"abilities": []})])
    assert drawings.described() == []
    drawing.write_text("0 Another robot", encoding="utf-8")
    assert drawings.described() == [{"name": "mine.ldr", "found": None}]
