"""Files of a site as they are stored: the same content makes the same file."""

import gzip
import json
import zipfile
from pathlib import Path
from typing import Any

PACKED = ".packed"
"""Ending of a file that is stored in gzip's format, as plain file servers do not compress."""
_FIXED_DATE = (1980, 1, 1, 0, 0, 0)


def undated(name: str) -> zipfile.ZipInfo:
    """Entry of an archive, without the date of its making."""
    return zipfile.ZipInfo(name, _FIXED_DATE)


def pack(source: Path, folder: Path) -> None:
    """Store a file compressed in a folder."""
    write_packed(folder / source.name, source.read_bytes())


def write_packed_json(path: Path, content: object) -> None:
    """Store values as compressed JSON, under ``path`` with another ending."""
    write_packed(path, _as_json(content).encode())


def read_packed_json(path: Path) -> Any:
    """What was stored under ``path`` by :func:`write_packed_json`."""
    return json.loads(gzip.decompress(path.with_name(path.name + PACKED).read_bytes()))


def write_json(path: Path, content: object) -> None:
    """Store values as JSON."""
    path.write_text(_as_json(content), encoding="utf-8")


def write_packed(path: Path, content: bytes) -> None:
    """Write content compressed, to a file of that name and `PACKED`."""
    packed = gzip.compress(content, 9, mtime=0)
    path.with_name(path.name + PACKED).write_bytes(packed)


def _as_json(content: object) -> str:
    return json.dumps(content, ensure_ascii=False, separators=(",", ":"))
