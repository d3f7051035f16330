"""Descriptions of datasets: there and back, refusals, differences."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from toy_data import SEEING, TOY

from bricksrl.data.schema import Description, digest_of
from bricksrl.errors import DataError


@pytest.mark.parametrize("description", [TOY, SEEING, replace(TOY, rate_hz=2.5)])
def test_description_survives_its_file(description: Description) -> None:
    assert Description.from_json(description.to_json(), "here") == description


@pytest.mark.parametrize(
    "changed",
    [
        {"observation": []},
        {"action": []},
        {"rate_hz": 0},
        {"rate_hz": -4.0},
        {"rate_hz": float("inf")},
        {"rate_hz": float("nan")},
        {"image_px": 16},
        {"camera": "webcam"},
        {"camera": "webcam", "image_px": -16},
        {"camera": "../webcam", "image_px": 16},
        {"bricksrl_dataset": 0},
        {"rate": 4.0},
    ],
)
def test_description_that_cannot_be_is_refused(changed: dict[str, Any]) -> None:
    values = {**json.loads(TOY.to_json()), **changed}
    del values["sha256"]
    whole = {**values, "sha256": digest_of(values)}
    with pytest.raises(DataError, match="here") as error:
        Description.from_json(json.dumps(whole).encode(), "here")
    assert "was edited" not in str(error.value)


def test_a_spoiled_letter_or_digit_is_noticed() -> None:
    data = TOY.to_json()
    for place, byte in enumerate(data):
        spoiled = data[:place] + bytes([byte ^ 1]) + data[place + 1 :]
        try:
            values = json.loads(spoiled)
        except ValueError:
            continue
        # Spaces between the values may change.
        if values != json.loads(data):
            with pytest.raises(DataError, match="here"):
                Description.from_json(spoiled, "here")


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({}, []),
        ({"env": "Other-v0"}, ["env Other-v0 instead of Toy-v0"]),
        ({"rate_hz": 5.0}, ["rate_hz 5.0 instead of 4.0"]),
        (
            {"observation": TOY.observation[:1]},
            ["observation [angle] instead of [angle, distance]"],
        ),
        (
            {"action": (replace(TOY.action[0], high=50.0),)},
            ["action with another unit or range of motor"],
        ),
        ({"robot": {"name": "other"}}, ["robot other instead of toy"]),
    ],
)
def test_differences_are_said_one_by_one(changed: dict[str, Any], says: list[str]) -> None:
    assert TOY.differences(replace(TOY, **changed)) == says


@pytest.mark.parametrize(("rate_hz", "written"), [(4.0, 4), (2.5, 2.5)])
def test_rate_is_whole_where_it_can_be(rate_hz: float, written: float) -> None:
    fps = replace(TOY, rate_hz=rate_hz).info(episodes=2, steps=9)["fps"]
    assert fps == written and type(fps) is type(written)


def test_columns_have_the_shapes_of_the_entries() -> None:
    features = SEEING.features
    assert features["observation.state"]["shape"] == [2]
    assert features["action"] == {"dtype": "float32", "shape": [1], "names": ["motor"]}
    assert features["observation.images.webcam"]["shape"] == [16, 16, 3]
    assert "observation.images.webcam" not in TOY.features
