"""Checkpoints: one file, written atomically, checked by a digest, and read without executing anything in it.

The file is a line that says what it is, the SHA-256 digest of the rest, and the rest: a dictionary of tensors, numbers, strings
and lists as `torch.save` writes it.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import struct
import warnings
from pathlib import Path
from typing import Any

import torch

from bricksrl.errors import CheckpointError
from bricksrl.files import write_durably

MAGIC = b"BricksRL checkpoint 1\n"
_DIGEST_SIZE = hashlib.sha256().digest_size


def save_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write ``state``; a file of that name stays whole until the new one is whole."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    payload = buffer.getvalue()
    write_durably(path, MAGIC + hashlib.sha256(payload).digest() + payload)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """What `save_checkpoint` wrote.

    Raises:
        CheckpointError: the file is missing, unreadable, damaged, or not one of ours.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CheckpointError(
            f"cannot read the checkpoint {path} ({error.strerror}); choose a folder that a run was made in"
        ) from None
    if not data.startswith(MAGIC):
        raise CheckpointError(f"{path} is no checkpoint of this version of BricksRL; choose another or train anew")
    digest, payload = data[len(MAGIC) : len(MAGIC) + _DIGEST_SIZE], data[len(MAGIC) + _DIGEST_SIZE :]
    if hashlib.sha256(payload).digest() != digest:
        raise CheckpointError(f"the checkpoint {path} is damaged; restore it from a copy or train anew")
    try:
        with warnings.catch_warnings(action="ignore"):  # what is odd about a foreign pickle, and it is refused anyway
            state = torch.load(io.BytesIO(payload), map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, struct.error, AttributeError, EOFError, LookupError, RuntimeError, TypeError, ValueError):
        state = None
    if not isinstance(state, dict):
        raise CheckpointError(f"the checkpoint {path} holds something else than a training state; train anew")
    return state
