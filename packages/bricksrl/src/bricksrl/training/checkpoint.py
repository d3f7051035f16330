"""Checkpoints: one file, written atomically, verified by a digest, loaded without executing code.

Format: a magic line, the SHA-256 digest of the rest, and nested tensors, numbers, strings and lists
as written by `torch.save`.
"""

import hashlib
import io
import warnings
from pathlib import Path
from typing import Any

import torch

from brickhub.files import parsing, reading, write_durably
from bricksrl.errors import CheckpointError

MAGIC = b"BricksRL checkpoint 1\n"
_DIGEST_SIZE = hashlib.sha256().digest_size


def save_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write ``state`` atomically."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    payload = buffer.getvalue()
    # The digest recognises a file that was cut or altered on its way, before torch reads it.
    digest = hashlib.sha256(payload).digest()
    write_durably(path, MAGIC + digest + payload)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Load a checkpoint. Raises CheckpointError if the file is missing, damaged, or no
    checkpoint."""
    with reading(
        "the checkpoint",
        path,
        CheckpointError,
        "choose the folder of a run",
    ):
        data = path.read_bytes()
    if not data.startswith(MAGIC):
        raise CheckpointError(
            f"{path} is not a checkpoint of this version of BricksRL; choose another or train again"
        )
    digest = data[len(MAGIC) : len(MAGIC) + _DIGEST_SIZE]
    payload = data[len(MAGIC) + _DIGEST_SIZE :]
    if hashlib.sha256(payload).digest() != digest:
        raise CheckpointError(f"the checkpoint {path} is damaged; restore a copy or train again")
    refusal = CheckpointError(f"the checkpoint {path} has no training state; train again")
    # A stranger's file has a right digest too, which says nothing about its content. Warnings are
    # about foreign pickles, which are refused anyway.
    with parsing(refusal), warnings.catch_warnings(action="ignore"):
        state = torch.load(io.BytesIO(payload), map_location="cpu", weights_only=True)
    if not isinstance(state, dict):
        raise refusal
    return state
