"""First thing that a process of a shaken test runs."""

import os
import sys
from pathlib import Path

if "BRICKS_TESTS_SHAKE" in os.environ:
    sys.path.append(str(Path(__file__).parent.parent))
    import shaking

    sys.path.pop()
    shaking.shake_everything()
