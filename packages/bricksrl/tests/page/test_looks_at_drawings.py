"""Looks at drawings, as the start page shows them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bricksrl.page.start import StartPage


def job(lines: list[str], code: int | None, *, action: str = "look", speaks: bool = False) -> Any:
    return SimpleNamespace(
        action=action,
        about="my.ldr",
        lines=lines,
        is_running=code is None,
        reader=SimpleNamespace(is_alive=lambda: speaks),
        process=SimpleNamespace(returncode=code),
    )


@pytest.mark.parametrize(
    ("one", "said", "stays"),
    [
        (job(["{}"], 0), [("take", "my.ldr", ["{}"])], False),
        (job(["a", "error: no part"], 1), [("fail", "my.ldr", "no part")], False),
        (job([], -9), [("fail", "my.ldr", "it was ended")], False),
        # Not all that it says is here yet.
        (job(["{}"], None), [], True),
        (job(["{}"], 0, speaks=True), [], True),
        (job(["{}"], 0, action="train"), [], True),
    ],
)
def test_what_was_found_in_a_drawing_is_shown_once_all_is_said(
    one: Any, said: list[tuple[Any, ...]], stays: bool
) -> None:
    told: list[tuple[Any, ...]] = []
    drawings = SimpleNamespace(
        take=lambda about, lines: told.append(("take", about, lines)),
        fail=lambda about, why: told.append(("fail", about, why)),
    )
    page = SimpleNamespace(_jobs=[one], _drawings=drawings)
    StartPage._take_looks(page)  # type: ignore[arg-type]
    assert told == said
    assert page._jobs == ([one] if stays else [])
