"""Whatever is not Python and belongs to a house is in its wheel."""

from __future__ import annotations

import fnmatch
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("house", ["brickhub", "bricktwin", "bricksrl"])
def test_each_file_is_named_as_data_of_its_package(house: str) -> None:
    project = tomllib.loads((ROOT / "packages" / house / "pyproject.toml").read_text())
    patterns = [
        f"{package.replace('.', '/')}/{pattern}"
        for package, given in project["tool"]["setuptools"]["package-data"].items()
        for pattern in given
    ]
    source = ROOT / "packages" / house / "src"
    files = [
        path.relative_to(source).as_posix()
        for path in (source / house).rglob("*")
        if path.is_file() and path.suffix not in (".py", ".pyc")
    ]
    assert files
    missing = [
        file for file in files if not any(fnmatch.fnmatch(file, pattern) for pattern in patterns)
    ]
    assert missing == []
