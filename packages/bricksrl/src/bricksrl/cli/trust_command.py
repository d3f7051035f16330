"""``bricksrl trust``: allow a run from elsewhere to execute the code that it names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.options import option
from brickhub.cli.terminal import print_line


@dataclass(frozen=True)
class Trust:
    """Allow a run or a policy made by somebody else to execute the Python files that it names.

    Some runs name Python files with a task, an algorithm or networks. Runs trained on this computer are trusted; one from
    elsewhere is refused until you allow it. Read its code first: it runs with all your permissions.

    Examples:
      bricksrl trust runs/from-a-friend
    """

    run: Annotated[Positional[Path], option(metavar="RUN")]
    """Folder of the run or of the policy."""

    def execute(self) -> None:
        from bricksrl.envs.trust import trust

        files = trust(self.run)
        print_line(f"{self.run} may run {', '.join(files)}" if files else f"{self.run} names no code; it needs no trust")
