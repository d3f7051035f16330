"""``bricktwin site``: the hub, robots and their physics for a browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import UseAppendAction

from brickhub.cli.terminal import print_line
from brickhub.errors import counted
from brickhub.options import Existing, option
from brickhub.user_files import check_there


@dataclass(frozen=True)
class MakeSite:
    """Make a folder of plain files that is a site: a hub, robots and their physics, in a browser's
    tab.

    Put the folder on any web space (https), or on a stick, where `python serve.py` in it starts
    site. It needs no other server, and works offline after the first visit. npm (Node.js) fetches
    what it is made of, once.

    Examples:
      bricktwin site --out site
      bricktwin site --out site --robot my_robot.ldr
      bricktwin site --out site --policies exported
      bricktwin site --out site --scene mat.png:fll
    """

    out: Annotated[Path, option(metavar="FOLDER")]
    """Folder of the site: new, empty, or a site, which is replaced."""
    policies: Annotated[Path | None, option(metavar="FOLDER")] = None
    """Folder of hub programs, NAME.py, as `bricksrl export --format hub` writes them, that are
    offered beside ours."""
    scene: Annotated[
        UseAppendAction[tuple[str, ...]], option(metavar="SCENE"), Existing(check_there)
    ] = ()
    """World for robots that drive, beside ours: a picture with its size, mat.png:1000x700 or
    mat.png:fll, or my_scene.py:MAT. May be repeated."""

    robot: Annotated[
        UseAppendAction[tuple[str, ...]], option(metavar="ROBOT"), Existing(check_there)
    ] = ()
    """Robot that is offered beside ours: a building plan, my_robot.ldr, or my_robot.py. May be
    repeated."""

    kits: bool = False
    """Put LEGO's package for its kits of 2026 into the site, as it is installed here (its licence,
    BUSL-1.1, permits non-commercial use), and the cart."""

    def execute(self) -> int:
        from brickhub.target import find
        from bricktwin.site.build import build_site
        from bricktwin.site.robots import OWN
        from bricktwin.target import load_scene, scene_name

        own = [find(name).robot for name in self.robot]
        scenes = {scene_name(reference): load_scene(reference) for reference in self.scene}
        files = build_site(
            self.out,
            (*own, *OWN),
            self.policies,
            scenes=scenes,
            has_kits=self.kits,
        )
        size_mb = sum(path.stat().st_size for path in files) / 1e6
        print_line(f"{self.out}: {counted(len(files), 'file')}, {size_mb:.1f} MB")
        print_line(f"start it: python {self.out / 'serve.py'}")
        return 0
