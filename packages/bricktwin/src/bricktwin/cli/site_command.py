"""``bricktwin site``: the hub, robots and their physics for a browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from brickhub.cli.terminal import print_line
from brickhub.errors import counted
from brickhub.options import option


@dataclass(frozen=True)
class MakeSite:
    """Make a folder of plain files that is a site: a hub, robots and their physics, in a browser's
    tab.

    Put the folder on any web space (https), or on a stick, where `python serve.py` in it starts the
    site. It needs no other server, and works offline after the first visit. npm (Node.js) fetches
    what it is made of, once.

    Examples:
      bricktwin site --out site
      bricktwin site --out site --policies exported
    """

    out: Annotated[Path, option(metavar="FOLDER")]
    """Folder of the site: new, empty, or a site, which is replaced."""
    policies: Annotated[Path | None, option(metavar="FOLDER")] = None
    """Folder of hub programs, NAME.py, as `bricksrl export --format hub` writes them, that are
    offered beside ours."""

    def execute(self) -> int:
        from bricktwin.site.build import build_site

        files = build_site(self.out, self.policies)
        size_mb = sum(path.stat().st_size for path in files) / 1e6
        print_line(f"{self.out}: {counted(len(files), 'file')}, {size_mb:.1f} MB")
        print_line(f"start it: python {self.out / 'serve.py'}")
        return 0
