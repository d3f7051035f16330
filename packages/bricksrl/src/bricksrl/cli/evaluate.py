"""Trained agents: ``bricksrl evaluate``, ``compare``, ``plot``, ``export`` and ``trust``."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional

from brickhub.cli.terminal import Interrupted, print_line, print_note
from brickhub.options import (
    Existing,
    Faults,
    Flag,
    JsonFlag,
    SavesNothing,
    Seed,
    existing_file,
    option,
)
from brickhub.user_files import check_there, without_folder
from bricksrl.cli.terminal import EmergencyStop, load_learning, placing, telling
from bricksrl.errors import DescriptionError, RunError, StoppedError, TwinError, counted, percent
from bricksrl.evaluation.class_table import ClassTable, class_table
from bricksrl.evaluation.comparison import Comparison, Group, compare, draw
from bricksrl.plotting import check_picture, number
from bricksrl.policies.by_name import TRAINED
from bricksrl.training.callbacks import WINDOW
from bricksrl.training.existing_run import existing_policy, existing_run
from bricksrl.training.run_folder import RunFolder
from bricksrl.training.trust import trust
from bricktwin.twin.physics import PHYSICS_REMEDY, read_physics

if TYPE_CHECKING:
    from rich.console import Console
    from torchrl.envs import EnvBase

    from bricksrl.evaluation import EvaluationResult


_FILMED_EPISODES = 3
_PHYSICS = existing_file("the physics in", TwinError, PHYSICS_REMEDY)


@dataclass(frozen=True)
class Evaluate(SavesNothing):
    """Evaluate a trained agent, without exploration or learning.

    Examples:
      bricksrl evaluate runs/spin
      bricksrl evaluate runs/spin --episodes 20 --seed 7 --json
      bricksrl evaluate runs/spin --video spin.mp4
      bricksrl evaluate runs/spin --hub ble
    """

    run: Annotated[Positional[Path], option(metavar="RUN"), Existing(existing_run)]
    """Folder that `bricksrl train` wrote."""
    env: Annotated[str | None, option(metavar="ENV"), Existing(check_there)] = None
    """Environment; by default that of the training. It gets the options of the training that it
    has."""
    episodes: Annotated[int, option(metavar="N")] = 5
    """Episodes to evaluate."""
    seed: Seed = 1000
    """Seed of the evaluation: with the run's seed it gives the episodes, which never are those of a
    training."""
    hub: Annotated[str | None, option(metavar="HUB")] = None
    """How to reach the robot: virtual, ble, ble:NAME, ble:ADDRESS, usb or usb:PORT; by default as
    in training."""
    realtime: Flag = False
    """Run the virtual robot in real time."""
    randomize: Flag = False
    """Draw new physics of the virtual robot for each episode; by default off, even if the training
    randomized."""
    physics: Annotated[Path | None, option(metavar="FILE"), _PHYSICS] = None
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes; by default as
    in training."""
    link: Annotated[str | None, option(metavar="LINK")] = None
    """Link of the virtual robot: Bluetooth as mac, linux or bad-room, or usb, usb-quick or
    usb-slow; by default as in training."""
    fault: Faults = ()
    best: Flag = False
    """Use the checkpoint of the best evaluation during training instead of the last one."""
    video: Annotated[Path | None, option(metavar="FILE")] = None
    """Film the first three of the episodes into this mp4 file."""
    json: JsonFlag = False

    def execute(self) -> None:
        given = {
            name: getattr(self, name) for name in ("hub", "link") if getattr(self, name) is not None
        }
        options: dict[str, Any] = {"realtime": self.realtime, "randomize": self.randomize, **given}
        options |= {"fault": self.fault} if self.fault else {}
        options |= {} if self.physics is None else {"physics": read_physics(self.physics)}
        if self.video is not None:
            from bricktwin.twin.render.video import check_film

            check_film(self.video)
        # What is wrong is said before torch is loaded, which takes long.
        origin = RunFolder(self.run).origin()
        if self.video is not None and options.get("hub", origin.options.hub) != "virtual":
            raise TwinError("only a virtual robot can be filmed; give --hub virtual, or no --video")
        load_learning()
        from bricksrl.evaluation.evaluator import evaluate
        from bricksrl.evaluation.film import filmed_env

        def report(episode: int, return_: float) -> None:
            if not self.json:
                print_line(f"episode {episode}/{self.episodes}  return {return_:.4g}")
            # A film of all episodes would take as long to look at as they take.
            if episode == _FILMED_EPISODES:
                films.close()

        def begin(env: EnvBase) -> None:
            films.enter_context(filmed_env(env, self.video, env.task.id))
            emergency_stop.attach(env)

        try:
            with (
                EmergencyStop(threading.Event(), print_note) as emergency_stop,
                ExitStack() as films,
            ):
                result = evaluate(
                    self.run,
                    self.env,
                    episodes=self.episodes,
                    seed=self.seed,
                    which="best" if self.best else "last",
                    save=False,
                    on_episode=report,
                    on_env=begin,
                    place=placing(emergency_stop.quiet),
                    **options,
                )
        except StoppedError:
            raise Interrupted("nothing was counted") from None
        # Said before it is saved: a full disk must not swallow it.
        for line in [result.to_json()] if self.json else describe(result):
            print_line(line)
        result.save()
        if self.video is not None:
            print_note(f"video    {self.video}")


def describe(result: EvaluationResult) -> Iterator[str]:
    """Text lines of an evaluation."""
    from bricksrl.evaluation.report import rows

    trained = counted(result.trained_episodes, "episode")
    yield (
        f"{result.env}, {counted(result.episodes, 'episode')} of {result.agent} after {trained} "
        "of training:"
    )
    for label, text in rows(result):
        yield f"{label:7}  {text}"


@dataclass(frozen=True)
class Compare(SavesNothing):
    """Compare runs: agents, seeds and environments in one table, with the probability that one
    agent beats the other.

    Runs that differ only in their seed form a group; the folder of `bricksrl train --seeds` stands
    for all its runs. Groups of five or more seeds have 95 % intervals. Runs are scored by their
    evaluations if all have one of the last checkpoint in the environment and physics of the
    training; else by their last episodes.

    Examples:
      bricksrl compare runs/sac runs/td3
      bricksrl compare runs/sac runs/td3 --out comparison.png
      bricksrl compare runs/* --json
      bricksrl compare --class class-7b
    """

    runs: Annotated[Positional[tuple[Path, ...]], option(metavar="RUN")] = ()
    """Folders of runs."""
    class_folder: Annotated[Path | None, option(name="class", metavar="FOLDER")] = None
    """List all runs below this folder instead, such as those of a class, and say which may be
    compared."""
    out: Annotated[Path | None, option(metavar="FILE")] = None
    """Picture of the learning curves: .png, .svg or .pdf."""
    json: JsonFlag = False

    def execute(self) -> None:
        if self.class_folder is not None:
            if self.runs or self.out is not None:
                raise DescriptionError(
                    "--class lists the runs below its folder, without a picture; omit RUN and "
                    "--out, or --class"
                )
            table = class_table(self.class_folder)
            if self.json:
                print_line(table.to_json())
            else:
                print_class(table)
            return
        if self.out is not None:
            check_picture(self.out)
        comparison = compare(self.runs)
        if self.json:
            print_line(comparison.to_json())
        else:
            print_comparison(comparison)
        if self.out is not None:
            draw(self.out, comparison.groups)
            if not self.json:
                print_line(f"picture  {self.out}")


@dataclass(frozen=True)
class Plot:
    """Plot the learning curves of runs, with reference lines: random actions, a scripted
    controller, the BricksRL paper.

    Examples:
      bricksrl plot runs/spin --out spin.png
      bricksrl plot runs/sac runs/td3 --out curves.png
    """

    runs: Annotated[Positional[tuple[Path, ...]], option(metavar="RUN")]
    """Folders of runs; the folder of `bricksrl train --seeds` stands for all its runs."""
    out: Annotated[Path, option(metavar="FILE")]
    """Picture to write: .png, .svg or .pdf."""

    def execute(self) -> None:
        check_picture(self.out)
        draw(self.out, compare(self.runs).groups)
        print_line(f"picture  {self.out}")


_PIPE_COLUMNS = 400
"""Width of a table that goes into a pipe or a file, which has none of its own: nothing is cut."""


def _console() -> Console:
    from rich.console import Console

    return Console() if sys.stdout.isatty() else Console(width=_PIPE_COLUMNS)


def print_class(table: ClassTable) -> None:
    """Print the table of a class, and what may be compared."""
    from rich.markup import escape
    from rich.table import Table

    columns = (
        "name",
        "task",
        "agent",
        "seed",
        "episodes",
        "return",
        "95 % interval",
        "differs in",
        "folder",
    )
    shown = Table(*columns, box=None, pad_edge=False)
    for row in table.rows:
        score = number(row.score)
        if not row.is_evaluated:
            score += "*"
        interval = ""
        if row.interval is not None:
            low, high = row.interval
            interval = f"{number(low)} to {number(high)}"
        texts = (
            row.name,
            without_folder(row.env),
            row.agent,
            f"{row.seed}",
            f"{row.episodes}",
            score,
            interval,
            "; ".join(row.differs),
            row.folder,
        )
        # A pupil's name may have brackets, which rich would take for its markup.
        shown.add_row(*map(escape, texts))
    console = _console()
    console.print(shown)
    notes = [
        (
            "return: mean of the evaluation, its interval over these episodes; it says nothing on "
            "other seeds"
        )
    ]
    if not all(row.is_evaluated for row in table.rows):
        notes.append(
            f"* not evaluated: mean of the last {WINDOW} episodes of training, in which the agent "
            "still tries things"
        )
    for line in ("", *notes, "", *table.sentences):
        console.print(line, highlight=False, markup=False)


def print_comparison(comparison: Comparison) -> None:
    """Print the table of a comparison, and the probabilities of improvement."""
    from rich.table import Table

    table = Table(
        "environment",
        "agent",
        "seeds",
        "episodes",
        "robot steps",
        "score",
        "95 % interval",
        box=None,
        pad_edge=False,
    )
    for group in comparison.groups:
        episodes = max(map(len, group.curves))
        cells = (
            str(len(group.seeds)),
            str(episodes),
            f"{group.steps:,}",
            number(group.score),
            _interval(group),
        )
        table.add_row(without_folder(group.env), group.agent, *cells)
    console = _console()
    console.print(table)
    console.print(
        "\nscore: return, interquartile mean over the seeds; of each run its "
        f"{comparison.scored_by}",
        highlight=False,
    )
    for pair in comparison.improvements:
        ends = pair.interval
        bounds = f" (95 % interval: {percent(ends.low)} to {percent(ends.high)})"
        line = (
            f"{without_folder(pair.env)}: {pair.agent} beats {pair.other} with probability "
            f"{percent(pair.probability)}{bounds}"
        )
        console.print(line, highlight=False)
    # Two agents in one environment, and too few seeds to say which is better.
    envs = {group.env for group in comparison.groups}
    if not comparison.improvements and len(comparison.groups) > len(envs):
        console.print(
            "whether one beats the other is chance with so few: train 5 seeds of each "
            "(`--seeds 5`)",
            highlight=False,
        )


def _interval(group: Group) -> str:
    if group.interval is None:
        return "needs 5 seeds"
    return f"{number(group.interval.low)} to {number(group.interval.high)}"


def _is_own(run: Path) -> bool:
    """Whether this is no folder, but an environment whose policy comes with BricksRL."""
    return str(run) in TRAINED and not run.exists()


def _existing_or_own(run: Path | str) -> None:
    """Raise RunError if there is no policy of this name."""
    if not _is_own(Path(run)):
        existing_policy(run)


@dataclass(frozen=True)
class Export:
    """Export a trained policy to a file that can be used without BricksRL.

    With --format hub the file is a Pybricks program with which the robot acts by itself, without a
    computer: a gait as it is, or a small network that is distilled from the policy. It is tried on
    the virtual hub, and its return compared.

    Other files are models. One is read back and compared with the policy. It maps observations
    [batch, n] in the units of the environment, and images [batch, side, side, 3] where the policy
    uses them, to actions [batch, m] in -1..1.

    Examples:
      bricksrl export runs/spin --out spin.pt2
      bricksrl export runs/walk --format hub --out walk.py
      bricksrl export Walker-v1 --format hub --out walk.py
      bricksrl export runs/spin --format onnx --out spin.onnx
    """

    run: Annotated[Positional[Path], option(metavar="RUN"), Existing(_existing_or_own)]
    """Folder of a run, or of a shared policy; with --format hub also an environment whose policy
    comes with BricksRL."""
    out: Annotated[Path, option(metavar="FILE")]
    """File to write, which must not exist."""
    format: Annotated[Literal["torch-export", "onnx", "hub"], option(metavar="NAME")] = (
        "torch-export"
    )
    """torch-export, for torch.export.load; onnx, which needs the packages onnx and onnxscript; or
    hub, a Pybricks program."""
    best: Flag = False
    """Use the checkpoint of the best evaluation during training instead of the last one."""

    def execute(self) -> None:
        load_learning()
        which: Literal["last", "best"] = "best" if self.best else "last"
        if self.format == "hub":
            from bricksrl.policies.hub_export import export_own, export_program

            with telling("playing and comparing"):
                if _is_own(self.run):
                    made = export_own(str(self.run), self.out)
                else:
                    made = export_program(self.run, self.out, which=which)
            print_line(
                f"written  {self.out}  (a {made.kind}: {made.program_bytes} bytes, and "
                f"{made.heap_bytes} of objects)"
            )
            print_line(
                f"computes for {made.computing_ms} ms a step at most, if a product takes what "
                "we infer"
            )
            print_line(
                f"return   {made.hub_return:.2f} on the virtual hub, {made.policy_return:.2f} of "
                "the policy"
            )
            return
        from bricksrl.policies.export import export_model

        if _is_own(self.run):
            raise RunError(f"the policy of {self.run} is exported with --format hub only; add it")
        difference = export_model(
            self.run,
            self.out,
            self.format,
            which=which,
        )
        print_line(
            f"written  {self.out}  (its actions differ by {difference:.2g} at most from the "
            "policy's)"
        )


@dataclass(frozen=True)
class Trust:
    """Allow a run, a policy or settings made by somebody else to execute the Python code that they
    name.

    Some runs name Python files or modules with a task, an algorithm, a transform or networks. Runs
    trained on this computer are trusted; one from elsewhere is refused until you allow it. Read its
    code first: it runs with all your permissions.

    Examples:
      bricksrl trust runs/from-a-friend
    """

    run: Annotated[Positional[Path], option(metavar="RUN")]
    """Folder of the run or of the policy, or a file of settings."""

    def execute(self) -> None:
        files = trust(self.run)
        if files:
            print_line(f"{self.run} may run {', '.join(files)}")
        else:
            print_line(f"{self.run} names no code; it needs no trust")
