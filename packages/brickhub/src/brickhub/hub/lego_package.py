"""LEGO's package ``legoeducation``, which is optional: its licence, BUSL-1.1, permits non-commercial use."""

from __future__ import annotations

import importlib
import logging
from typing import Any

from brickhub.errors import MediumUnavailableError, Reason

NAME = "legoeducation"


_SILENT = logging.NullHandler()


def lego_package(*, is_silent: bool = False) -> Any:
    """The package. ``is_silent``: what it logs is not printed, as errors say it. Raises MediumUnavailableError if it is not
    installed."""
    if is_silent:
        logging.getLogger(NAME).addHandler(_SILENT)
    try:
        return importlib.import_module(NAME)
    except ImportError:
        remedy = f"run `pip install 'brickhub[{NAME}]'` (its licence, BUSL-1.1, permits non-commercial use)"
        raise MediumUnavailableError(f"LEGO's package {NAME} is not installed; {remedy}", Reason.NO_SERVICE) from None
