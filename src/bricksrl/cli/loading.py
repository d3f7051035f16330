"""Loading what takes seconds, in one piece."""

from __future__ import annotations

import importlib
import signal
from types import FrameType

_HEAVY = ("torch", "torchrl.data", "torchrl.envs")


def load_learning() -> None:
    """Import what all learning needs; a Ctrl-C meanwhile counts when it is done, because these modules may swallow it.

    Raises:
        RenderingUnavailableError: ``MUJOCO_GL`` names a library that does not work.
    """
    from bricksrl.twin.bodies import check_mujoco

    interrupted = False

    def remember(_signum: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True

    before = signal.signal(signal.SIGINT, remember)
    try:
        check_mujoco()
        for name in _HEAVY:
            importlib.import_module(name)
            if interrupted:
                break
    finally:
        signal.signal(signal.SIGINT, before)
    if interrupted:
        raise KeyboardInterrupt
