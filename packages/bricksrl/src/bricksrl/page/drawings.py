"""Drawings on the start page: the building plans in the folder, and what their robots can learn."""

import contextlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from brickhub.user_files import PLAN_ENDINGS

_MAX_DRAWINGS = 30


class Drawings:
    """The building plans in a folder.

    Args:
        folder: of the plans; those in folders within it do not count.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._looks: dict[str, tuple[float, dict[str, Any]]] = {}
        """What was found in each plan, and when the plan was written that it was found in."""

    def names(self) -> list[str]:
        """File names of the plans, the latest first."""
        written: list[tuple[float, str]] = []
        with contextlib.suppress(OSError):
            for path in self._folder.iterdir():
                if path.name.lower().endswith(PLAN_ENDINGS):
                    written.append((-self._written_s(path.name), path.name))
        return [name for _, name in sorted(written)[:_MAX_DRAWINGS]]

    def goals(self) -> list[str]:
        """References to what the robots of these plans were found to be able to learn."""
        goals: list[str] = []
        for name in self.names():
            found = self._found(name)
            abilities = [] if found is None else found["abilities"]
            goals += [f"{name}:{ability['name']}" for ability in abilities if not ability["reason"]]
        return goals

    def take(self, name: str, lines: Iterable[str]) -> None:
        """Keep what ``bricksrl learn NAME --look --json`` has said of a plan."""
        for line in lines:
            with contextlib.suppress(ValueError):
                found = json.loads(line)
                if isinstance(found, dict) and "abilities" in found:
                    self._looks[name] = (self._written_s(name), found)

    def fail(self, name: str, line: str) -> None:
        """Keep what that command has said of a plan that cannot be read."""
        self._looks[name] = (self._written_s(name), {"error": line, "abilities": []})

    def described(self) -> list[dict[str, Any]]:
        """The plans for the page: ``name``, and ``found``, null before anybody has looked."""
        return [{"name": name, "found": self._found(name)} for name in self.names()]

    def _found(self, name: str) -> dict[str, Any] | None:
        """What was found in a plan, if it has not changed since."""
        written_s, found = self._looks.get(name, (0.0, None))
        return found if written_s == self._written_s(name) else None

    def _written_s(self, name: str) -> float:
        """Time at which a plan was last written; 0 if it is gone."""
        try:
            return (self._folder / name).stat().st_mtime
        except OSError:
            return 0.0
