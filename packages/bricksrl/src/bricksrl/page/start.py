"""Start page: environments, runs, building plans and the hub check, without a command typed.

Each press starts the command of the same name in a process of its own; its page is opened, its lines are shown. Values of presses
are only ever chosen from names that the page itself knows.
"""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bricksrl.envs.arenas import ARENAS, get_arena_task
from bricksrl.envs.registry import is_simulation, list_envs
from bricksrl.errors import BricksError, PageError
from bricksrl.page.board import Board
from bricksrl.page.server import PageOptions, PageServer, chosen
from bricksrl.policies.by_name import TRAINED
from bricksrl.training.run_folder import RunFolder
from bricktwin.robots import ROBOTS

HUBS = ("virtual", "ble", "usb")
PLANS = tuple({robot.model: name for name, robot in reversed(ROBOTS.items()) if robot.model}.values())[::-1]
"""Robots that have a building plan of their own."""
_ON_STAGE = ("play", "drive", "game", "watch", "build")
"""Actions of which one ends the one before."""
_MAX_JOBS, _MAX_LINES, _MAX_RUNS, _MAX_POINTS, _LAST_EPISODES = 12, 60, 30, 60, 5
_REFRESH_S, _END_S = 1.0, 8.0
_PAGE_LINE = re.compile(r"live page: (\S+)")


Launch = Callable[[Sequence[str], Path], "subprocess.Popen[str]"]


def launch(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """Start a command of ``bricksrl`` in a folder, with all that it says on one pipe; Ctrl-C does not reach it."""
    return subprocess.Popen(  # noqa: S603  our own interpreter
        [sys.executable, "-u", "-m", "bricksrl", *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


@dataclass
class Job:
    """A command in a process of its own, with its lines and the address of its page."""

    number: int
    action: str
    about: str
    process: subprocess.Popen[str]
    url: str = ""
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_LINES))

    def listen(self) -> None:
        """Read its lines until it ends."""
        for line in self.process.stdout or ():
            if (match := _PAGE_LINE.search(line)) is not None:
                self.url = match[1]
            else:
                self.lines.append(line.rstrip())

    @property
    def is_running(self) -> bool:
        return self.process.poll() is None

    def end(self) -> None:
        """Ask it to end as Ctrl-C does, and kill it if it does not."""
        self.process.terminate()
        try:
            self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()

    def described(self) -> dict[str, Any]:
        """What the page shows of it."""
        shown = {"number": self.number, "action": self.action, "about": self.about, "url": self.url, "lines": list(self.lines)}
        return shown | {"code": self.process.poll()}


class StartPage(PageServer):
    """Start page, served while entered; its jobs end with it.

    Args:
        folder: folder in which the commands run; their runs are in its folder ``runs``.
        options: address of this page and of those of its jobs.
        launch: starts the process of a command.
    """

    def __init__(self, folder: Path, options: PageOptions | None = None, launch: Launch = launch) -> None:
        super().__init__(Board(), self._press, lambda: None, options)
        self._folder, self._launch, self._jobs = folder, launch, list[Job]()
        self._ended = threading.Event()
        self._results = tempfile.TemporaryDirectory(prefix="bricksrl-page-")
        self._envs = {env_id: summary for env_id, summary in list_envs().items() if not is_simulation(env_id)}
        shown = sorted(self._envs.items(), key=lambda item: item[0] not in TRAINED)
        cards = [{"env": env_id, "summary": summary, "actions": ["play", "train", "drive"]} for env_id, summary in shown]
        cards += [{"env": env_id, "summary": get_arena_task(env_id).summary, "actions": ["game"]} for env_id in ARENAS]
        self.board.update_status(title="BricksRL", cards=cards, plans=list(PLANS), hubs=list(HUBS))
        self._publish()

    def __enter__(self) -> StartPage:
        super().__enter__()
        self._start("bricksrl-page-jobs", self._refresh)
        return self

    def close(self) -> None:
        """End all jobs and stop serving."""
        self._ended.set()
        for job in self._jobs:
            job.end()
        super().close()
        self._results.cleanup()

    def file(self, name: str) -> tuple[str, bytes] | None:
        """Files of the page, and results of its jobs."""
        results = {path.name: path for path in Path(self._results.name).iterdir()}
        if name not in results:
            return super().file(name or "start.html")
        return {".png": "image/png", ".pdf": "application/pdf"}[results[name].suffix], results[name].read_bytes()

    # ---------------------------------------------------------------- presses

    def _press(self, action: str, value: Any) -> None:
        message = ""
        try:
            if action == "end":
                for job in self._jobs:
                    if job.number == value:
                        job.end()
            elif action != "left":
                self._do(action, value)
        except BricksError as error:
            message = str(error)
        self.board.update_status(message=message)
        self._publish()

    def _do(self, action: str, value: Any) -> None:
        """Start the command of a press. Raises PageError for one that the page does not have."""
        names = value if isinstance(value, list) else [value]
        about = ", ".join(map(str, names))
        match action:
            case "play" | "drive":
                words = [action, chosen("environment", value, self._envs), *(("--page",) if action == "play" else ())]
            case "train":
                env = chosen("environment", value, self._envs)
                seed = sum(one["env"] == env for one in self._runs())  # or the same run would come again
                words = ["train", env, "--page", "--no-film", "--seed", str(seed)]
            case "game":
                words = ["team", chosen("arena", value, ARENAS), "--page"]
            case "watch":
                words = ["play", self._run(value), "--page"]
            case "compare":
                words = ["compare", *map(self._run, names), "--out", f"{self._results.name}/{self._next}.png"]
            case "build":
                words = ["plan", "show", chosen("plan", value, PLANS)]
            case "booklet":
                words = ["plan", "steps", chosen("plan", value, PLANS), "--out", f"{self._results.name}/{self._next}.pdf"]
            case "check":
                env, hub = (*names, "", "")[:2]
                words = ["hub", "check", chosen("environment", env, self._envs), "--hub", chosen("hub", hub, HUBS), "--yes"]
            case _:
                raise PageError(f"the page has no button {action!r:.40}; reload it")
        if action in _ON_STAGE:
            for job in self._jobs:
                if job.action in _ON_STAGE:
                    job.end()
        if "--page" in words or action in _ON_STAGE:
            words += ["--page-host", self._options.page_host]
        job = Job(self._next, action, about, self._launch(words, self._folder))
        self._jobs = [*self._jobs, job][-_MAX_JOBS:]
        threading.Thread(target=job.listen, name="bricksrl-page-job", daemon=True).start()

    @property
    def _next(self) -> int:
        """Number of the next job."""
        return 1 + max((job.number for job in self._jobs), default=0)

    def _run(self, name: Any) -> str:
        return f"runs/{chosen('run', name, [run['name'] for run in self._runs()])}"

    # ---------------------------------------------------------------- what is shown

    def _refresh(self) -> None:
        while not self._ended.wait(_REFRESH_S):
            self._publish()

    def _publish(self) -> None:
        self.board.update_status(jobs=[job.described() for job in self._jobs[::-1]], runs=self._runs())

    def _runs(self) -> list[dict[str, Any]]:
        """The runs in the folder, the latest first, with the mean return of the last episodes."""
        found = []
        configs = sorted(self._folder.glob("runs/*/config.json"), key=lambda path: path.stat().st_mtime, reverse=True)
        for config in configs[:_MAX_RUNS]:
            run = RunFolder(config.parent)
            with contextlib.suppress(BricksError):
                origin, returns = run.origin(), [episode.return_ for episode in run.read_episodes()]
                last = returns[-_LAST_EPISODES:]
                points = returns[:: 1 + len(returns) // _MAX_POINTS]
                about = {"env": origin.env, "agent": origin.agent, "episodes": len(returns), "points": points}
                found.append({"name": config.parent.name, **about, "return": sum(last) / len(last) if last else None})
        return found
