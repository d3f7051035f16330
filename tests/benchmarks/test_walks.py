"""Walks: an option stays in few files."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from benchmarks.session import RESULTS
from benchmarks.walks import walked
from brickhub.seed import check_seed


def test_value_is_found_where_a_frame_holds_it():
    holder = SimpleNamespace(seed=12_321)
    with walked(lambda _, value: value == 12_321) as files:
        check_seed(holder.seed)
    assert list(files) == ["brickhub/seed.py"]
    with walked(lambda _, value: value == 12_321) as files:
        check_seed(3)
    assert not list(files)


@pytest.mark.parametrize(
    "name", ["configuration of a run", "`--seed`", "`--randomize`", "`--episodes`"]
)
def test_walk_visits_nine_files_at_most(name):
    files = json.loads((RESULTS / "walks.json").read_text())["walks"][name]
    assert 2 <= len(files) <= 9
