"""Tables of this package: CSV files with comments."""

import csv
from importlib import resources


def read_table(package: str, name: str) -> list[dict[str, str]]:
    """Rows of ``name.csv`` in a package, by column; lines that begin with ``#`` are comments."""
    text = resources.files(package).joinpath(f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
