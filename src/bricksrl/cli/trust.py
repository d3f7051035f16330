"""``bricksrl trust``: allow the code that a run from elsewhere names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from bricksrl.cli.terminal import print_line


@dataclass(frozen=True)
class Trust:
    """Allow a run, or a policy, that somebody else made to execute the Python files that it names.

    Runs with a task, an algorithm or networks in files execute them. Those that were trained on this computer are trusted; one
    from elsewhere is refused until you allow it. Read its code first: it may do whatever you may do.

    Examples:
      bricksrl trust runs/from-a-friend
    """

    run: Annotated[Positional[Path], arg(metavar="RUN")]
    """Folder of the run or of the policy."""

    def execute(self) -> int:
        """Remember it, and say what may run now."""
        from bricksrl.envs.trust import trust

        code = trust(self.run)
        print_line(f"{self.run} may run {', '.join(code)}" if code else f"{self.run} names no code; it needed no trust")
        return 0
