"""LEGO's package ``legoeducation``, which is optional: its licence, BUSL-1.1, permits non-commercial use."""

from __future__ import annotations

import importlib
from typing import Any

from brickhub.errors import MediumUnavailableError, Reason

NAME = "legoeducation"


def lego_package() -> Any:
    """The package. Raises MediumUnavailableError if it is not installed."""
    try:
        return importlib.import_module(NAME)
    except ImportError:
        remedy = f"run `pip install 'brickhub[{NAME}]'` (its licence, BUSL-1.1, permits non-commercial use)"
        raise MediumUnavailableError(f"LEGO's package {NAME} is not installed; {remedy}", Reason.NO_SERVICE) from None
