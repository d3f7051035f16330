"""Comments of ours in a plan: ports, end stops, marks of parts."""

from __future__ import annotations

import pytest

from brickhub.errors import PlanError
from bricktwin.plans.ldraw_file import parse

PLACE = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"


def read(comment: str) -> None:
    parse(f"0 !BRICKSRL {comment}\n{PLACE}\n", "plan.ldr")


@pytest.mark.parametrize(
    "comment",
    [
        "PORT A",
        "PORT A spike-large",
        "PORT A spike-large 90",
        "STOPS -90 90",
        "FREE",
        "FIXED",
        "BALL 0 1 2",
    ],
)
def test_comments_that_are_understood(comment: str) -> None:
    read(comment)


@pytest.mark.parametrize(
    "comment",
    [
        "PORT",
        "PORT AB",
        "PORT A spike-large x",
        "PORT A spike-large 90 more",
        "STOPS 90",
        "STOPS 90 -90",
        "STOPS 5 5",
        "BALL 0 1",
        "BALL 0 1 2 3",
        "LOOSE",
    ],
)
def test_others_are_named(comment: str) -> None:
    with pytest.raises(PlanError, match=f"line 1: '{comment}' is not understood; write ROBOT"):
        read(comment)
