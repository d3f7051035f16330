"""TorchRL's log, which is not ours to print."""

import contextlib
import logging
from collections.abc import Iterator


@contextlib.contextmanager
def without_torchrl_notes() -> Iterator[None]:
    """Context in which TorchRL prints warnings only: by default it writes notes, in colour, on
    standard output, such as the size of each replay buffer."""
    logger = logging.getLogger("torchrl")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)
