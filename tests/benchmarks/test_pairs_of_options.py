"""The covering array of options."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from benchmarks.__main__ import run
from benchmarks.option_pairs import OPTIONS, all_pairs, next_row, pairs_of, words_of


@pytest.mark.parametrize("command", OPTIONS)
def test_every_pair_is_in_a_row_unless_it_is_refused(command: str) -> None:
    options, rng = OPTIONS[command], random.Random(0)
    pairs = all_pairs(options)
    refused = set(rng.sample(sorted(pairs, key=sorted), 5))
    left, rows = pairs - refused, 0
    while left and (row := next_row(options, left, refused, rng)) is not None:
        assert list(row) == list(options) and not pairs_of(row) & refused
        left -= pairs_of(row)
        rows += 1
    assert len(left) < 4 and rows < 80, "a pair may have no row that is not refused"
    assert (
        words_of(command, {name: values[0] for name, values in options.items()}, Path("made"))[0]
        == command
    )


@pytest.mark.slow
def test_some_rows_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The script sets them for all of its process, which has other tests after this one.
    monkeypatch.setenv("MUJOCO_GL", "disable")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    words = [
        "option_pairs",
        "--rows",
        "2",
        "--commands",
        "train",
        "record",
        "evaluate",
        "--folder",
        str(tmp_path),
    ]
    assert run(words) == 0
    found = json.loads((tmp_path / "study.json").read_text())
    assert all(found[command]["rows"] == 2 and not found[command]["faults"] for command in OPTIONS)
