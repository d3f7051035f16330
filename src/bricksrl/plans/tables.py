"""Tables of this package: CSV files with comments."""

from __future__ import annotations

import csv
import importlib.resources


def read_table(name: str) -> list[dict[str, str]]:
    """Rows of ``name.csv`` by column; lines that begin with ``#`` are comments."""
    text = importlib.resources.files("bricksrl.plans").joinpath(f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
