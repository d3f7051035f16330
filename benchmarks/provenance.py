"""Provenance of a result: the commit, the day, and the code that it was measured with."""

from __future__ import annotations

import functools
import subprocess
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.code import Code

ROOT = Path(__file__).parent.parent


def working_tree() -> Code:
    """The code as it is."""

    def source(path: str) -> str | None:
        file = ROOT / path
        return file.read_text(encoding="utf-8") if file.is_file() else None

    files = [*ROOT.glob("packages/*/src/**/*.py"), *ROOT.glob("benchmarks/*.py")]
    return Code(source, [file.relative_to(ROOT).as_posix() for file in files])


@functools.cache
def code_of(module: str) -> dict[str, str]:
    """``commit`` ("" without git), ``day`` and ``digest`` of a benchmark's code, when this process
    asks first: later changes of the files are not what has run."""
    done = subprocess.run(
        ["git", "rev-parse", "HEAD"],  # noqa: S607  the user's own git
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return {
        "commit": done.stdout.strip()[:12] if done.returncode == 0 else "",
        "day": datetime.now(UTC).date().isoformat(),
        "digest": working_tree().digest(module),
    }
