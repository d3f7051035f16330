"""``python -m bricksrl.cli``."""

from __future__ import annotations

import sys

from bricksrl.cli import main

sys.exit(main())
