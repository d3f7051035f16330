"""Program cache: hash of the program that this computer last downloaded to each hub, to skip repeated downloads."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from brickhub.files import user_cache, write_durably

_log = logging.getLogger(__name__)


class ProgramRecord:
    """File with the hash of the program on each hub, by address and slot; ``None`` for the file in the user's cache."""

    def __init__(self, path: Path | None) -> None:
        self._path = path or user_cache() / "programs.json"

    def get(self, address: str) -> int | None:
        """Hash of the program on a hub, if known."""
        program_hash = self._load().get(address)
        return program_hash if isinstance(program_hash, int) else None

    def set(self, address: str, program_hash: int | None) -> None:
        hashes = self._load()
        hashes[address] = program_hash
        try:
            write_durably(self._path, json.dumps(hashes).encode())
        except OSError as error:
            _log.debug("cannot note which program is on the hub: %s", error)

    def _load(self) -> dict[str, object]:
        try:
            hashes = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return hashes if isinstance(hashes, dict) else {}
