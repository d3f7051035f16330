"""A run that is there, told by its config, without what reads it."""

from pathlib import Path

from brickhub.files import folder_with
from bricksrl.errors import RunError

CONFIG = "config.json"
POLICY = "policy.json"
"""Files that say what was trained: of a run, and of a shared policy."""


def existing_run(path: Path | str) -> None:
    """Raise RunError if there is no run in a folder, which is not read."""
    folder = Path(path)
    if not (folder / CONFIG).exists():
        raise RunError(f"there is no run in {folder}; choose {folder_with(folder, CONFIG)}")


def existing_policy(path: Path | str) -> None:
    """Raise RunError if a folder has neither a run nor a shared policy; it is not read."""
    if not (Path(path) / POLICY).exists():
        existing_run(path)
