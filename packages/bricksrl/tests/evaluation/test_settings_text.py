from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bricksrl.agents import AGENTS, preset
from bricksrl.agents.sac import SACSettings
from bricksrl.errors import DescriptionError, RunError
from bricksrl.evaluation.settings_text import read_settings, with_changes
from bricksrl.training.trust import trust


@given(st.floats(1e-6, 1.0), st.lists(st.integers(1, 512), min_size=1, max_size=4), st.booleans())
def test_numbers_lists_and_flags_are_parsed(rate: float, hidden: list[int], flag: bool) -> None:
    text = ",".join(map(str, hidden))
    changed = with_changes(
        SACSettings(),
        [f"learning_rate={rate!r}", f"hidden={text}", f"scale-rewards={flag}"],
    )
    assert (changed.learning_rate, changed.hidden, changed.scale_rewards) == (
        rate,
        tuple(hidden),
        flag,
    )


@pytest.mark.parametrize("agent", [agent for agent in AGENTS if agent != "random"])
def test_every_setting_can_be_given(agent: str, tmp_path: Path) -> None:
    settings = preset("default", agent)
    values = dataclasses.asdict(settings)
    texts = [
        f"{name}={','.join(map(str, value)) if isinstance(value, tuple) else value}"
        for name, value in values.items()
    ]
    assert with_changes(settings, texts) == settings
    path = tmp_path / "settings.json"
    path.write_text(json.dumps(values))
    assert read_settings(path, preset("paper", agent)) == settings
    path.write_text(json.dumps({"settings": values, "provenance": {"trials": 3}}))
    assert read_settings(path, preset("paper", agent)) == settings


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("learning_rat=1", "did you mean 'learning_rate'"),
        ("colour=red", "there is no setting 'colour'"),
        ("learning_rate", "NAME=VALUE"),
        ("learning_rate=fast", "give a number"),
        ("batch_size=1.5", "whole number"),
        ("hidden=a,b", "whole number"),
        ("mirror=perhaps", "True or False"),
        ("angles=round", "choose "),
        ("gamma=7", "gamma"),
    ],
)
def test_invalid_settings_text_raises(change: str, says: str) -> None:
    with pytest.raises(DescriptionError, match=says) as caught:
        with_changes(SACSettings(), [change])
    assert "\n" not in str(caught.value)


def test_settings_file_of_any_editor_is_read(tmp_path: Path) -> None:
    path = tmp_path / "settings.json"
    path.write_bytes('{"network": "n\u00e4tze.py", "batch_size": 7}'.encode("utf-8-sig"))
    with pytest.raises(
        RunError, match=r"would run code \(n\u00e4tze.py\) .* `bricksrl trust \S*settings.json`$"
    ):
        read_settings(path, SACSettings())
    assert trust(path) == ("n\u00e4tze.py",)
    assert read_settings(path, SACSettings()) == SACSettings(network="n\u00e4tze.py", batch_size=7)


def test_invalid_settings_file_raises(tmp_path: Path) -> None:
    path = tmp_path / "settings.json"
    with pytest.raises(DescriptionError, match="cannot read"):
        read_settings(path, SACSettings())
    for text in ("{", "[1]", '{"settings": 3}', '{"colour": 1}', '{"gamma": "high"}'):
        path.write_text(text)
        with pytest.raises(DescriptionError) as caught:
            read_settings(path, SACSettings())
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("gamma=1", 1.0),
        ("gamma= 0.5 ", 0.5),
        ("learning_rate=3e-4", 3e-4),
        ("hidden=64", (64,)),
        ("hidden=64,32", (64, 32)),
        ("hidden=(64, 32)", (64, 32)),
        ("hidden=[8]", (8,)),
        ("batch-size=7", 7),
        ("mirror=True", True),
        ("mirror=yes", True),
        ("mirror=true", True),
        ("mirror=1", True),
        ("mirror=no", False),
        ("mirror=FALSE", False),
        ("mirror=0", False),
        ("network=12", "12"),
        ("network=", ""),
        ("network=a=b.py", "a=b.py"),
        ("angles=raw", "raw"),
    ],
)
def test_texts_are_read_as_what_the_setting_is(change: str, value: object) -> None:
    name = change.partition("=")[0].replace("-", "_")
    read = getattr(with_changes(SACSettings(), [change]), name)
    assert read == value and type(read) is type(value)


def test_nothing_is_a_value_where_it_may_be_one() -> None:
    settings = preset("paper", "cql")
    assert settings.lagrange_threshold == 5.0
    assert with_changes(settings, ["lagrange_threshold=none"]).lagrange_threshold is None
    assert with_changes(settings, ["lagrange_threshold=3"]).lagrange_threshold == 3.0
    with pytest.raises(DescriptionError, match="gamma"):
        with_changes(settings, ["gamma=none"])


def test_numbers_of_a_file_are_those_of_the_settings(tmp_path: Path) -> None:
    """JSON writes 1 for 1.0, and a list for a tuple."""
    path = tmp_path / "settings.json"
    path.write_text('{"gamma": 1, "hidden": [8, 4], "mirror": false, "batch_size": 7}')
    read = read_settings(path, SACSettings())
    assert read == SACSettings(gamma=1.0, hidden=(8, 4), mirror=False, batch_size=7)
    assert type(read.gamma) is float and type(read.hidden) is tuple


def test_what_changes_nothing_is_told() -> None:
    with pytest.raises(DescriptionError) as raised:
        with_changes(SACSettings(), ["gamma"])
    assert str(raised.value) == (
        "'gamma' changes nothing; write NAME=VALUE, such as learning_rate=3e-4"
    )
    with pytest.raises(DescriptionError) as raised:
        with_changes(SACSettings(), ["gama=0.5"])
    names = ", ".join(field.name for field in dataclasses.fields(SACSettings))
    assert str(raised.value) == (
        f"there is no setting 'gama' (did you mean 'gamma'?); choose one of {names}"
    )
