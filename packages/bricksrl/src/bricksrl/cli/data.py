"""``bricksrl data``: inspect, check, repair, merge, split, correct, plot, import, export and share
datasets."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import Positional

from brickhub.cli.terminal import print_line
from brickhub.fields import Count, Range
from brickhub.files import folder_with, only_writer, quoted
from brickhub.options import Existing, Flag, Seed, option, parsed
from bricksrl.cli.terminal import load_learning
from bricksrl.data.csv_files import export_csv, is_one_table
from bricksrl.data.dataset import Dataset, dataset_folder, existing_dataset, read_dataset
from bricksrl.data.edit import merge, salvage, select, split
from bricksrl.data.formats import (
    export_minari,
    import_lerobot,
    import_paper,
)
from bricksrl.data.integrity import check, recover
from bricksrl.data.lerobot import is_lerobot
from bricksrl.data.schema import FILES
from bricksrl.data.selection import Selection
from bricksrl.data.summary import plot, summarise
from bricksrl.errors import DataError, counted
from bricksrl.training.existing_run import CONFIG, POLICY

DatasetArgument = Annotated[
    Positional[Path],
    option(metavar="DIR", help="Folder of the dataset."),
    Existing(existing_dataset),
]


YesOrNo = Annotated[
    Literal["yes", "no"] | None,
    parsed(str, "yes|no", choices=("yes", "no")),
    option(),
]
Format = Literal["minari", "csv"]


@dataclass(frozen=True)
class Info:
    """Show a summary of datasets: episodes, transitions, returns, and their origin.

    The folder of a run stands for its dataset.

    Examples:
      bricksrl data info datasets/walker_expert
      bricksrl data info datasets/* --json
    """

    datasets: Annotated[
        Positional[tuple[Path, ...]], option(metavar="DIR"), Existing(existing_dataset)
    ]
    """Folders of datasets."""
    json: Flag = False
    """Print one JSON object per dataset and line."""

    def execute(self) -> None:
        for path in _not_empty(self.datasets):
            summary = summarise(path)
            if self.json:
                print_line(summary.to_json())
                continue
            images = f", images of {summary.camera}" if summary.camera else ""
            named = (
                ("observation", f"{', '.join(summary.observation)}{images}"),
                ("action", ", ".join(summary.action)),
            )
            print_line(f"{path}:")
            for label, value in (*summary.rows(), *named):
                print_line(f"  {label:17} {value}")


@dataclass(frozen=True)
class CheckData:
    """Check every file, digest and step of a dataset, without changing anything. Exit code 1 when
    something is wrong.

    Examples:
      bricksrl data check datasets/walker_expert
    """

    dataset: DatasetArgument

    def execute(self) -> int:
        faults = check(self.dataset)
        for line in [fault.detail for fault in faults] or ["all is well"]:
            print_line(line)
        return 1 if faults else 0


@dataclass(frozen=True)
class Repair:
    """Repair a dataset after its recording was killed, or save the intact episodes of a damaged
    one.

    Without --out the index is rebuilt from the intact files; exit code 1 if something is still
    wrong. With --out the dataset is not changed, and its intact episodes are written to a new one.

    Examples:
      bricksrl data repair datasets/walker_expert
      bricksrl data repair datasets/damaged --out datasets/saved
    """

    dataset: Annotated[Positional[Path], option(metavar="DIR")]
    """Folder of the dataset, which may lack what others have."""
    out: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder for the intact episodes of a damaged dataset, which must not exist."""

    def execute(self) -> int:
        root = dataset_folder(self.dataset)
        if self.out is not None:
            dataset, lost = salvage(root, self.out)
            for line in lost:
                print_line(f"lost: {line}")
            print_line(f"{counted(len(dataset.rows), 'episode')}: {self.out}")
            return 0
        if not (root / FILES["description"]).exists():
            raise DataError(
                f"there is no dataset of ours in {root}; choose "
                f"{folder_with(root, FILES['description'])}"
            )
        with only_writer(root, DataError):
            dataset, adopted, removed = recover(root, rebuild=True)
        print_line(
            f"{counted(len(dataset.rows), 'episode')}; {adopted} new in the index, "
            f"{counted(removed, 'unfinished file')} removed"
        )
        faults = check(root)
        for fault in faults:
            print_line(fault.detail)
        if faults:
            print_line(
                "save the intact episodes to a new dataset with `bricksrl data repair "
                f"{quoted(self.dataset)} --out DIR`"
            )
        return 1 if faults else 0


@dataclass(frozen=True)
class Merge:
    """Merge datasets of the same robot, rate and shape into a new one with few files; a single one
    is compacted.

    Examples:
      bricksrl data merge datasets/monday datasets/tuesday --out datasets/both
    """

    datasets: Annotated[
        Positional[tuple[Path, ...]], option(metavar="DIR"), Existing(existing_dataset)
    ]
    """Folders of datasets, in order."""
    out: Annotated[Path, option(metavar="DIR")]
    """Folder of the new dataset, which must not exist."""

    def execute(self) -> None:
        dataset = merge(_not_empty(self.datasets), self.out)
        print_line(f"{_size(dataset)}: {self.out}")


@dataclass(frozen=True)
class Split:
    """Split a dataset into two new ones, by episodes drawn at random.

    Examples:
      bricksrl data split datasets/walker --share 0.8 --out datasets/train --rest datasets/test
    """

    dataset: DatasetArgument
    out: Annotated[Path, option(metavar="DIR")]
    """Folder for the drawn share, which must not exist."""
    rest: Annotated[Path, option(metavar="DIR")]
    """Folder for the other episodes, which must not exist."""
    share: Annotated[float, Range(0.0, 1.0), option(metavar="SHARE")] = 0.8
    """Share of the episodes, between 0 and 1."""
    seed: Seed = 0
    """Seed of the random split."""

    def execute(self) -> None:
        parts = split(
            self.dataset,
            self.out,
            self.rest,
            self.share,
            self.seed,
        )
        for dataset, path in zip(parts, (self.out, self.rest), strict=True):
            print_line(f"{_size(dataset)}: {path}")


@dataclass(frozen=True)
class _Conditions:
    """The dataset, and what its episodes are chosen by; all conditions that are given count."""

    dataset: DatasetArgument
    out: Annotated[Path, option(metavar="DIR")]
    """Folder of the new dataset, which must not exist; the old one is not changed."""
    episodes: Annotated[str, option(metavar="0-9,12")] = ""
    """Numbers of episodes, which begin at 0, with ranges."""
    success: YesOrNo = None
    """Those in which the task was solved, or was not."""
    whole: YesOrNo = None
    """Those that ran to their end, or were broken off."""
    return_min: Annotated[float | None, option(metavar="RETURN")] = None
    """Those with at least this return."""
    return_max: Annotated[float | None, option(metavar="RETURN")] = None
    """Those with at most this return."""
    steps_min: Annotated[Count | None, option(metavar="N")] = None
    """Those with at least so many steps."""
    steps_max: Annotated[Count | None, option(metavar="N")] = None
    """Those with at most so many steps."""

    def _select(self, *, keep: bool) -> None:
        given = {field.name: getattr(self, field.name) for field in fields(Selection)}
        for name in ("success", "whole"):
            if given[name] is not None:
                given[name] = given[name] == "yes"
        selection = Selection(**{name: value for name, value in given.items() if value is not None})
        before = len(read_dataset(self.dataset).rows)
        dataset = select(self.dataset, self.out, selection, keep=keep)
        print_line(f"{_size(dataset)}, of {counted(before, 'episode')}: {self.out}")


@dataclass(frozen=True)
class Keep(_Conditions):
    """Keep the episodes of a dataset that meet all conditions, in a new one.

    Examples:
      bricksrl data keep datasets/by_hand --episodes 0-9,12 --out datasets/good
      bricksrl data keep datasets/walker --success yes --steps-min 20 --out datasets/solved
    """

    def execute(self) -> None:
        self._select(keep=True)


@dataclass(frozen=True)
class Remove(_Conditions):
    """Remove the episodes of a dataset that meet all conditions: the others go to a new one.

    Examples:
      bricksrl data remove datasets/by_hand --episodes 3 --out datasets/good
      bricksrl data remove datasets/walker --whole no --out datasets/whole
    """

    def execute(self) -> None:
        self._select(keep=False)


@dataclass(frozen=True)
class PlotData:
    """Plot the returns and every channel of a dataset.

    Examples:
      bricksrl data plot datasets/walker_expert --out walker.png
    """

    dataset: DatasetArgument
    out: Annotated[Path, option(metavar="FILE")]
    """PNG file to write."""

    def execute(self) -> None:
        plot(self.dataset, self.out)
        print_line(f"picture  {self.out}")


@dataclass(frozen=True)
class Import:
    """Import a dataset that LeRobot recorded, or datasets of the BricksRL paper: folders of
    memory-mapped tensors, of one task or of all.

    Examples:
      bricksrl data import lerobot/my_walker --out datasets/walker
      bricksrl data import BricksRL-Datasets --out datasets/paper
      bricksrl data import my_buffer --env Walker-v0 --out datasets/walker
    """

    source: Annotated[Positional[Path], option(metavar="DIR")]
    """Folder of one such dataset, or, of the paper's, a parent folder of several."""
    out: Annotated[Path, option(metavar="DIR")]
    """Folder to write to."""
    env: Annotated[str | None, option(metavar="ENV")] = None
    """Environment of the datasets; by default inferred from the robot that LeRobot names, or from
    the names of the folders."""

    def execute(self) -> None:
        if is_lerobot(self.source):
            load_learning()
            imported = [(self.source, import_lerobot(self.source, self.out, env=self.env))]
        else:
            imported = import_paper(self.source, self.out, env=self.env)
        for source, dataset in imported:
            print_line(f"{source}: {dataset.description.env}, {_size(dataset)}: {dataset.root}")


@dataclass(frozen=True)
class ExportData:
    """Export a dataset to CSV, for spreadsheets, or to Minari's format. What reads Parquet reads
    the dataset itself.

    Examples:
      bricksrl data export datasets/walker --out walker.csv
      bricksrl data export datasets/walker --format csv --out walker_csv
      bricksrl data export datasets/walker --out ~/.minari/datasets/lego/walker-v0
    """

    dataset: DatasetArgument
    out: Annotated[Path, option(metavar="PATH")]
    """Folder to write, which must not exist; a name that ends in .csv is one file with all
    episodes."""
    format: Annotated[
        Format | None,
        parsed(str, "FORMAT", choices=get_args(Format)),
        option(),
    ] = None
    """Format to write: csv has a file an episode, without images. By default csv for a name that
    ends in .csv, else minari."""

    def execute(self) -> None:
        is_table = is_one_table(self.out)
        if is_table and self.format == "minari":
            raise DataError(
                f"{self.out} would be a folder of Minari's; leave out --format, or the ending"
            )
        chosen = self.format or ("csv" if is_table else "minari")
        if chosen == "csv":
            export_csv(self.dataset, self.out)
        else:
            load_learning()
            export_minari(self.dataset, self.out)
        print_line(f"{chosen:7} {self.out}")


def _look_for_shared(path: Path) -> None:
    """Look for what can be uploaded: a dataset, a run, a shared policy or a log."""
    if not any((path / name).exists() for name in (CONFIG, POLICY)) and not path.is_file():
        existing_dataset(path)


@dataclass(frozen=True)
class Push:
    """Upload a dataset, the policy of a run, or the log of a measured robot to the Hugging Face
    hub, with a card.

    Log in first: `hf auth login`, or set HF_TOKEN.

    Examples:
      bricksrl data push datasets/walker_expert me/walker-expert
      bricksrl data push runs/walker me/walker-sac --policy
      bricksrl data push measured/log.jsonl me/my-two-wheeler
    """

    folder: Annotated[Positional[Path], option(metavar="PATH"), Existing(_look_for_shared)]
    """Folder of the dataset, or of the run; or the log that `bricksrl twin measure` wrote."""
    repo: Annotated[Positional[str], option(metavar="REPO")]
    """Repository on the Hugging Face hub: owner/name."""
    policy: Flag = False
    """Share the policy of the run instead of its data: a safetensors file, never a pickle."""
    private: Flag = False
    """Make the repository private."""
    licence: Annotated[str, option(metavar="NAME")] = "mit"
    """Licence on the card, by the hub's name for it, such as cc-by-4.0."""

    def execute(self) -> None:
        from bricksrl.data.share import push_dataset, push_log
        from bricksrl.policies.sharing import push_policy

        load_learning()
        push: Callable[..., str] = push_dataset
        if self.policy:
            push = push_policy
        elif self.folder.is_file():
            # A log of a measured robot is a single file, a dataset always a folder.
            push = push_log
        print_line(
            push(
                self.folder,
                self.repo,
                private=self.private,
                licence=self.licence,
            )
        )


@dataclass(frozen=True)
class Pull:
    """Download a dataset, or a policy, from the Hugging Face hub. It is checked before it is moved
    to its folder.

    Examples:
      bricksrl data pull me/walker-expert --out datasets/walker_expert
      bricksrl data pull me/walker-sac --policy --out policies/walker
    """

    repo: Annotated[Positional[str], option(metavar="REPO")]
    """Repository on the Hugging Face hub: owner/name."""
    out: Annotated[Path, option(metavar="DIR")]
    """Folder to write to, which must not exist."""
    policy: Flag = False
    """Download a policy instead of a dataset."""
    revision: Annotated[str | None, option(metavar="NAME")] = None
    """Branch, tag or commit; by default the newest."""

    def execute(self) -> None:
        from bricksrl.data.share import pull_dataset
        from bricksrl.policies.sharing import pull_policy

        load_learning()
        pull = pull_policy if self.policy else pull_dataset
        print_line(str(pull(self.repo, self.out, revision=self.revision)))


def _size(dataset: Dataset) -> str:
    return f"{counted(len(dataset.rows), 'episode')}, {counted(dataset.steps, 'step')}"


def _not_empty(paths: tuple[Path, ...]) -> tuple[Path, ...]:
    if not paths:
        raise DataError("no dataset is named; give its folder")
    return paths
