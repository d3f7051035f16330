"""The README of bricksrl, and the links in those of all three packages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from readme import Readme

from bricksrl.cli.app import parse

PACKAGES = Path(__file__).parents[2]


def test_its_commands_exist() -> None:
    commands = Readme(PACKAGES / "bricksrl" / "README.md", "bricksrl").commands
    assert commands
    for words in commands:
        assert callable(parse(words).execute), words


@pytest.mark.parametrize("name", ["brickhub", "bricktwin", "bricksrl"])
def test_readmes_link_to_what_is_there(name: str) -> None:
    folder = PACKAGES / name
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", (folder / "README.md").read_text(encoding="utf-8"))
    assert targets
    for target in targets:
        if not target.startswith("https:"):
            assert (folder / target).exists(), target


@pytest.mark.parametrize("name", ["brickhub", "bricktwin", "bricksrl"])
def test_readmes_install_all_that_they_need(name: str) -> None:
    needed = {"brickhub": 1, "bricktwin": 2, "bricksrl": 3}[name]
    line = " ".join(
        f"./packages/{house}" for house in ("brickhub", "bricktwin", "bricksrl")[:needed]
    )
    assert f"    pip install {line}\n" in (PACKAGES / name / "README.md").read_text(
        encoding="utf-8"
    )
