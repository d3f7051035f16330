"""Order and errors of dicts and sets; source: `data/micropython_containers.json`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hub_programs import output
from hypothesis import given
from hypothesis import strategies as st

from brickhub.virtual.micropython.containers import HashTable, HubDict, HubSet, hash_of

_KNOWN = json.loads(
    (Path(__file__).parents[1] / "data" / "micropython_containers.json").read_text(encoding="utf-8")
)


@pytest.mark.parametrize("known", _KNOWN["programs"])
def test_order(known: dict[str, list[str]]) -> None:
    assert output("\n".join(known["program"])).split("\n") == known["printed"]


@pytest.mark.parametrize(("call", "printed"), _KNOWN["refusals"].items())
def test_refusals(call: str, printed: str) -> None:
    assert output(f"try:\n    {call}\nexcept Exception as e:\n    print(repr(e))") == printed


def test_dict_of_subclass_object_raises() -> None:
    """A hub iterates over it and expects pairs."""
    source = (
        "class D(dict): pass\nd = D()\nd['key'] = 1\ntry:\n    dict(d)\n"
        "except ValueError as e:\n    print(e)"
    )
    assert output(source) == "dict update sequence has wrong length"


def test_hash_order_is_process_independent() -> None:
    program = (
        "from brickhub.virtual.micropython.containers import HubSet; "
        "print(list(HubSet(['one', 'two', 'three', 'four'])))"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(outputs) == 1


_KEYS = st.one_of(
    st.text(max_size=3),
    st.integers(-20, 20),
    st.sampled_from([0.5, 1.5, None, (), (1, 2), b"a", True]),
)


@given(st.lists(st.tuples(st.sampled_from(["set", "delete", "first", "copy"]), _KEYS)))
def test_dict_and_set_content_equals_python(steps: list[tuple[str, object]]) -> None:
    ours, theirs = HubDict(), {}
    members, plain = HubSet(), set()
    for number, (step, key) in enumerate(steps):
        if step == "set":
            ours[key] = theirs[key] = number
            members.add(key)
            plain.add(key)
        elif step == "delete":
            assert ours.pop(key, None) == theirs.pop(key, None)
            members.discard(key)
            plain.discard(key)
        elif step == "first" and theirs:
            first, value = ours.popitem()
            assert theirs.pop(first) == value
            members.remove(first)
            plain.remove(first)
        elif step == "copy":
            ours, members = ours.copy(), members.copy()
        assert len(ours) == len(list(ours)) == len(theirs)
        assert ours == theirs
        assert set(ours) == set(members) == plain == members


@given(st.lists(_KEYS, unique=True))
def test_keys_follow_hash_slots(keys: list[object]) -> None:
    table = HashTable()
    for key in keys:
        table.add(key)
    assert sorted(map(id, table)) == sorted(map(id, keys))
    for key in keys:
        found = hash_of(key)
        if found is not None:
            size = len(table.slots)
            place = (found & 0xFFFF_FFFF) % size
            while table.slots[place] is not key:
                assert table.slots[place] in keys  # no gap before it
                place = (place + 1) % size
