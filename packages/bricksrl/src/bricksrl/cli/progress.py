"""Progress of trainings on the terminal: of one run, and of several seeds."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bars

from brickhub.cli.terminal import Interrupted, print_line, print_note
from brickhub.files import quoted
from brickhub.user_files import without_folder
from bricksrl.cli.evaluate import print_comparison
from bricksrl.errors import counted
from bricksrl.evaluation import multi_seed
from bricksrl.evaluation.comparison import compare
from bricksrl.training.callbacks import Callback, Episode, Phase, Progress, RobotState, RunResult
from bricksrl.training.config import TrainConfig

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.errors import BricksError


_BARS = "▁▂▃▄▅▆▇█"
_SPARKLINE_EPISODES = 30


class RunProgress(Callback):
    """Progress of a run: on a terminal a bar with a sparkline of the last returns, elsewhere a line
    per episode.

    Attributes:
        run_dir: folder of the run; ``None`` before it started.
        episodes_done: whole episodes in the folder.
        on_ready: called with the environment before the robot moves.

    Args:
        hub: how the robot is reached; finding a real one may take half a minute.
    """

    def __init__(self, hub: str = "virtual") -> None:
        self._hub = hub
        self.run_dir: Path | None = None
        self.episodes_done = 0
        self.on_ready: Callable[[EnvBase], None] = lambda env: None
        self._asynchronous = False
        self._trouble = ""
        self._returns: list[float] = []
        self._is_live = sys.stdout.isatty()
        text = TextColumn(
            "return {task.fields[value]}  {task.fields[spark]}  {task.fields[rate]}", markup=False
        )
        self._bar = Bars(
            TextColumn("episode"),
            MofNCompleteColumn(),
            BarColumn(20),
            text,
        )
        self._task = self._bar.add_task(
            "",
            total=None,
            value="-",
            spark="",
            rate="",
        )

    def on_env(self, env: EnvBase) -> None:
        self.on_ready(env)
        if self._hub != "virtual":
            self.note(f"connecting to the robot ({self._hub})")

    def on_start(
        self,
        config: TrainConfig,
        run_dir: Path,
        episodes_done: int,
    ) -> None:
        self.run_dir = run_dir
        self.episodes_done = episodes_done
        self._asynchronous = bool(config.asynchronous)
        print_line(
            f"{without_folder(config.agent)} on {without_folder(config.env)}, seed {config.seed}: "
            f"{run_dir}"
        )
        self._bar.update(self._task, total=config.episodes, completed=episodes_done)
        self._show()

    def on_note(self, note: str) -> None:
        self.note(note)

    def on_episode(
        self,
        episode: Episode,
        progress: Progress,
    ) -> None:
        self.episodes_done = episode.episode
        self._returns.append(episode.return_)
        rate = f"{progress.steps_per_s:.3g} steps/s  {clock(progress.remaining_s)} left"
        learning = ""
        if self._asynchronous and episode.updates_per_step is not None:
            learning = f"  {episode.updates_per_step:.3g} updates/step"
        if self._is_live:
            spark = sparkline(self._returns[-_SPARKLINE_EPISODES:])
            shown: dict[str, Any] = {
                "value": f"{episode.return_:.4g}",
                "spark": spark,
                "rate": f"{rate}{learning}",
            }
            self._bar.update(self._task, completed=episode.episode, **shown)
            return
        robot = f"{episode.robot}  " if episode.robot else ""
        start = "  (random start)" if episode.phase is Phase.PREFILL else ""
        line = (
            f"episode {episode.episode}/{progress.episodes_total}  return {episode.return_:.4g}  "
        )
        print_line(f"{line}{robot}{rate}{start}{learning}")

    def on_link_lost(
        self,
        episode: int,
        length: int,
        error: BricksError,
    ) -> None:
        event = "the robot is out of reach"
        if length:
            event = f"the link broke in episode {episode} after {counted(length, 'step')}"
        line = f"{event} ({error}); trying to reach it again, Ctrl-C ends it"
        # Each try may fail for the same reason, which is said once.
        if line != self._trouble:
            print_line(line)
        self._trouble = line

    def on_robot(
        self,
        robot: str,
        state: RobotState,
        reason: str,
    ) -> None:
        if state is RobotState.PLACED:
            print_note(f"put {robot} where an episode starts")
        elif state is RobotState.LEFT:
            print_note(f"{robot} has left: {reason}")
        elif state is RobotState.GIVEN_UP:
            print_note(f"{robot} is given up: {reason}")

    def on_catching_up(self, updates: int) -> None:
        print_line(
            f"the robot is done; {counted(updates, 'update')} left to learn, Ctrl-C leaves out "
            "the rest"
        )

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Inside, the bar does not overwrite a question."""
        self.close()
        yield
        self._show()

    def on_end(self, result: RunResult) -> None:
        self.close()

    def note(self, line: str) -> None:
        """Print a line for the user, apart from the results."""
        if self._is_live:
            self._bar.console.print(line, markup=False, highlight=False)
        else:
            print_note(line)

    def saved(self) -> str:
        """Text on what is saved if the run ends now."""
        if self.run_dir is None:
            return "no episode was finished, so nothing was saved"
        resume = f"`bricksrl resume {quoted(self.run_dir)}`"
        if not self.episodes_done:
            # The folder has the configuration and the untrained networks.
            return f"no episode was finished; {resume} begins again"
        return f"saved {counted(self.episodes_done, 'episode')} in {self.run_dir}; {resume} goes on"

    def close(self) -> None:
        """Restore the terminal; may be called repeatedly."""
        if self._is_live:
            self._bar.stop()

    def _show(self) -> None:
        if self._is_live and self.run_dir is not None:
            self._bar.start()


def clock(seconds: float) -> str:
    """Duration as ``h:mm:ss``, or ``m:ss`` below one hour."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def sparkline(values: list[float]) -> str:
    """Sparkline with a bar per value, scaled between the lowest and the highest one."""
    low = min(values)
    high = max(values)
    if low == high:
        return _BARS[len(_BARS) // 2] * len(values)
    heights = [round((value - low) / (high - low) * (len(_BARS) - 1)) for value in values]
    return "".join(_BARS[height] for height in heights)


class SeedsProgress(Bars):
    """Progress of all seeds: a live row of each on a terminal, a line per event elsewhere."""

    def __init__(
        self,
        seeds: range,
        episodes: int,
        *,
        live: bool | None = None,
    ) -> None:
        state = TextColumn(
            "{task.fields[value]}  {task.fields[state]}  {task.fields[node]}", markup=False
        )
        is_live = sys.stdout.isatty() if live is None else live
        super().__init__(
            TextColumn("seed {task.description}  episode"),
            MofNCompleteColumn(),
            state,
            disable=not is_live,
        )
        self._ids = {
            seed: self.add_task(
                str(seed),
                total=episodes,
                value="",
                state="waiting",
                node="",
            )
            for seed in seeds
        }
        self._episodes = episodes

    def tell(
        self,
        seed: int,
        message: dict[str, Any],
    ) -> None:
        """Update the row of a seed from a message of its run; may be called from several
        threads."""
        changes = dict[str, Any]()
        line = ""
        if "started" in message:
            changes = {"state": "training", "node": message.get("node", "")}
            # Who starts a second time was lost in between.
            if self.tasks[self._ids[seed]].fields["state"] != "waiting":
                line = f"its worker was lost; resumed after episode {message['started']}"
        elif "episode" in message:
            changes = {
                "state": "training",
                "completed": message["episode"],
                "value": f"return {message['return']:.4g}",
            }
            line = f"episode {message['episode']}/{self._episodes}  {changes['value']}"
        elif "evaluated" in message:
            changes = {"state": "evaluated", "value": f"return {message['evaluated']:.4g}"}
            line = f"trained and evaluated  {changes['value']}"
        elif "error" in message:
            changes = {"state": "failed"}
        self.update(self._ids[seed], **changes)
        if line and self.disable:
            print_line(f"seed {seed}  {line}")


def train_seeds(
    config: TrainConfig,
    count: int,
    on: str | None = None,
) -> None:
    """Train ``count`` seeds and print their summary."""
    multi_seed.check_count(count)
    try:
        with SeedsProgress(range(config.seed, config.seed + count), config.episodes) as progress:
            multi_seed.train_seeds(
                config,
                count,
                on=on,
                on_line=progress.tell,
            )
    except KeyboardInterrupt:
        folder = config.run_dir
        if folder is None or not folder.exists():
            raise Interrupted("no seed had started, so nothing was saved") from None
        resumes = f"`bricksrl resume {quoted(folder)}/seed-...` resumes a seed"
        raise Interrupted(f"what was trained is in {folder}; {resumes}") from None

    print_comparison(compare(config.run_dir or ""))
    print_line(f"summary          {config.run_dir}/summary.json")
    print_line(f"learning curves  {config.run_dir}/learning_curves.png")
