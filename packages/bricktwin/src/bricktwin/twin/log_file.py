"""Files of logs: one JSON object per line, first a header."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from brickhub.errors import DescriptionError, TwinError
from brickhub.files import write_durably

_Log = TypeVar("_Log")


def write_lines(path: Path, lines: Iterable[dict[str, Any]]) -> None:
    """Write a log, replacing an existing one; its folder is created. Raises WriteError if that is impossible."""
    write_durably(path, "".join(json.dumps(line) + "\n" for line in lines).encode())


def read_lines(path: Path, make: Callable[[dict[str, Any], list[dict[str, Any]]], _Log], writer: str) -> _Log:
    """What is made of the header and the other lines of a file. Raises TwinError if the file cannot be read, or is no such log.

    Args:
        make: may raise what the content of another file causes, and DescriptionError with what is wrong with it.
        writer: the command that writes such files.
    """
    try:
        header, *lines = [json.loads(line) for line in path.read_bytes().splitlines() if line]
        return make(header, lines)
    except OSError as error:
        reason = error.strerror
    except DescriptionError as error:
        reason = str(error)
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError):
        reason = "it is another file, or damaged"
    raise TwinError(f"cannot read the log {path} ({reason}); give a file that `{writer}` wrote")
