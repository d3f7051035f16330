"""Matplotlib without a window."""

import contextlib
import importlib
import os
import sys


def import_matplotlib() -> None:
    """Import Matplotlib, even if ``MPLBACKEND`` names an unavailable window system, as no window is
    opened."""
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop("MPLBACKEND", None)
    try:
        matplotlib = importlib.import_module("matplotlib")
        if backend is not None:
            # A backend that the user asked for is kept, unless this Matplotlib does not know it.
            with contextlib.suppress(ValueError):
                matplotlib.rcParams["backend"] = backend
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
