"""``bricksrl plan show``: a building plan in the browser."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from brickhub.cli.terminal import Interrupted
from bricksrl.cli.page import LivePageGroup, PageAddress, announce
from bricktwin.cli.plan_commands import PlanArgument, read_named_plan


@dataclass(frozen=True)
class ShowPlan:
    """Show a building plan in the browser in 3D, step by step, with sliders for its joints. Ctrl-C ends it.

    Examples:
      bricksrl plan show walker
      bricksrl plan show my_robot.mpd --page-host 0.0.0.0
    """

    plan: PlanArgument
    live_page: LivePageGroup = PageAddress()

    def execute(self) -> None:
        from bricksrl.page.plan_view import PlanView
        from bricksrl.page.server import PageServer

        view = PlanView(read_named_plan(self.plan))
        try:
            with PageServer(view.board, view.press, lambda: None, self.live_page.page_options()) as server:
                announce(server.url)
                threading.Event().wait()
        except KeyboardInterrupt:
            raise Interrupted from None
