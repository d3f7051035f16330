"""``pytest -p byte_code``: our modules are read as byte code, where it is kept.

pytest compiles the modules of a distribution that has a plugin of its own, to rewrite their
assertions; in a process that may keep no byte code, it does so each time.
"""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

HOUSES = ("brickhub", "bricktwin", "bricksrl")


class _ByteCode(PathFinder):
    @classmethod
    def find_spec(cls, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """As `PathFinder`, of our modules alone."""
        is_ours = name.partition(".")[0] in HOUSES
        return PathFinder.find_spec(name, path, target) if is_ours else None


sys.meta_path.insert(0, _ByteCode)
