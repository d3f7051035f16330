from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forked import ForkServer, Scratch
from toy_data import SEEING, TOY, record

from bricksrl.cli import main
from bricksrl.data import Episodes, load
from bricksrl.data.edit import merge, salvage, split
from bricksrl.data.formats import export_minari
from bricksrl.data.integrity import check, recover
from bricksrl.data.summary import plot
from bricksrl.errors import DataError, WriteError
from bricksrl.training import RunFolder, TrainConfig


def same(ours: Episodes, theirs: Episodes) -> bool:
    names = (
        "observation",
        "action",
        "reward",
        "next_observation",
        "terminated",
        "truncated",
        "episode",
        "intervention",
    )
    pairs = [(getattr(ours, name), getattr(theirs, name)) for name in names]
    pairs += [
        (a, b)
        for a, b in ((ours.image, theirs.image), (ours.next_image, theirs.next_image))
        if a is not None
    ]
    about = [row.about for row in ours.rows] == [row.about for row in theirs.rows]
    return all(np.array_equal(a, b) for a, b in pairs) and about


@pytest.mark.parametrize("description", [TOY, SEEING])
def test_merged_data_equals_one_recording(tmp_path: Path, description) -> None:
    parts = [
        record(tmp_path / "a", (3, 5), description),
        record(tmp_path / "b", (4,), description, first_seed=2),
    ]
    merge(parts, tmp_path / "joined")
    whole = load(record(tmp_path / "whole", (3, 5, 4), description))
    assert same(load(tmp_path / "joined"), whole)
    assert len(list((tmp_path / "joined/data").rglob("*.parquet"))) == 1
    assert check(tmp_path / "joined") == []
    record(tmp_path / "joined", (2,), description, first_seed=3)  # a recording goes on in it
    assert len(load(tmp_path / "joined").rows) == 4 and check(tmp_path / "joined") == []


def test_full_file_starts_new_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.data.edit.STEPS_PER_FILE", 7)
    source = record(tmp_path / "a", (3, 5, 4, 2), SEEING)
    merge([source], tmp_path / "tidy")
    assert (
        len(list((tmp_path / "tidy/data").rglob("*.parquet")))
        == len(list((tmp_path / "tidy/videos").rglob("*.mp4")))
        == 2
    )
    assert same(load(tmp_path / "tidy"), load(source)) and check(tmp_path / "tidy") == []
    assert recover(tmp_path / "tidy", rebuild=True)[1:] == (0, 0), (
        "the second file is none of a killed recording"
    )
    record(tmp_path / "tidy", (2,), SEEING, first_seed=4)  # it does not replace the second file
    assert (
        same(load(tmp_path / "tidy"), load(record(source, (2,), SEEING, first_seed=4)))
        and check(tmp_path / "tidy") == []
    )


def test_merging_other_kind_raises(tmp_path: Path) -> None:
    parts = [record(tmp_path / "a"), record(tmp_path / "b", description=replace(TOY, rate_hz=5.0))]
    with pytest.raises(DataError, match="rate_hz 5.0 instead of 4.0"):
        merge(parts, tmp_path / "joined")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_split_parts_need_different_folders(tmp_path: Path) -> None:
    source = record(tmp_path / "a", (3, 5))
    with pytest.raises(DataError, match="each a separate folder"):
        split(source, tmp_path / "x", tmp_path / "y" / ".." / "x", 0.5, 0)
    (tmp_path / "file").touch()
    with pytest.raises(WriteError, match="cannot write .*file/y"):
        split(source, tmp_path / "x", tmp_path / "file" / "y", 0.5, 0)
    assert not (tmp_path / "x").exists(), "both parts or none"


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    source = record(tmp_path / "a")
    (tmp_path / "there").mkdir()
    for write in (
        lambda out: merge([source], out),
        lambda out: split(source, tmp_path / "x", out, 0.5, 0),
    ):
        with pytest.raises(DataError, match="exists already"):
            write(tmp_path / "there")
    assert not (tmp_path / "x").exists()


def test_split_has_each_episode_once(tmp_path: Path) -> None:
    source = record(tmp_path / "a", (3, 4, 5, 6, 7))
    split(source, tmp_path / "most", tmp_path / "rest", 0.6, 1)
    seeds = [[row.about.seed for row in load(tmp_path / name).rows] for name in ("most", "rest")]
    assert len(seeds[0]) == 3 and sorted(seeds[0] + seeds[1]) == [0, 1, 2, 3, 4]
    split(source, tmp_path / "other", tmp_path / "rest of it", 0.6, 2)
    assert [row.about.seed for row in load(tmp_path / "other").rows] != seeds[0]
    with pytest.raises(DataError, match="empty"):
        split(source, tmp_path / "all", tmp_path / "none", 1.0, 0)


def test_complete_episodes_are_recovered(tmp_path: Path) -> None:
    root = record(tmp_path / "a", (3, 4, 5, 6))
    data = root / "data/chunk-000/file-001.parquet"
    data.write_bytes(data.read_bytes()[:-50])
    (root / "meta/episodes/chunk-000/file-002.parquet").write_bytes(b"PAR1 no longer PAR1")
    with pytest.raises(DataError):
        load(root)
    index, lost = salvage(root, tmp_path / "saved")
    assert [row.about.seed for row in index.rows] == [0, 3] and len(lost) == 3
    assert check(tmp_path / "saved") == []
    (root / "meta/episodes/chunk-000/file-002.parquet").unlink()
    _, lost = salvage(root, tmp_path / "again")
    assert (
        lost[0] == "1 episode before the last one: no row in meta/episodes"
        and "episode 1: " in lost[1]
    )


def test_check_names_damage(tmp_path: Path) -> None:
    assert check(record(tmp_path / "good", description=SEEING)) == []
    root = record(tmp_path / "a")
    (root / "data/chunk-000/notes.pkl").write_bytes(b"\x80\x04.")
    (root / "meta/.part-abc").write_bytes(b"half")
    (root / "meta/stats.json").unlink()
    for other in ("002", "003"):
        shutil.copy(
            root / "data/chunk-000/file-000.parquet", root / f"data/chunk-000/file-{other}.parquet"
        )
    wrong = "\n".join(map(str, check(root)))
    assert "notes.pkl is not a file of a dataset; it was not opened" in wrong
    assert (
        ".part-abc was left by a recording" in wrong
        and "file-003.parquet was left by a recording" in wrong
    )
    assert "stats.json is missing" in wrong
    assert "episode 2: " in wrong and "is damaged" in wrong


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted in /proc")
def test_check_leaves_no_thread_that_could_abort_the_exit(
    processes: ForkServer | Scratch, tmp_path: Path
) -> None:
    root = record(tmp_path / "d")
    code = (
        "import os, sys; from pathlib import Path; from bricksrl.data.integrity import check\n"
        "threads = lambda: len(os.listdir('/proc/self/task'))\n"
        f"before = threads(); check(Path({str(root)!r})); sys.exit(threads() - before)"
    )
    assert processes.run((), tmp_path, os.environ, 60.0, code).returncode == 0


def ways_into(folder: Path, outside: Path) -> list[Path]:
    """Paths of new things in a folder."""
    (outside / "link").symlink_to(folder)
    (outside / "other").mkdir()
    return [
        folder / "joined",
        folder / "data/chunk-000/joined",
        folder / "new/er/joined",
        outside / "link/joined",
        outside / f"other/../{folder.name}/joined",
        Path(os.path.relpath(folder / "joined")),
    ]


@pytest.mark.parametrize("way", range(6))
def test_nothing_is_written_into_a_dataset(tmp_path: Path, way: int) -> None:
    part = record(tmp_path / "my data", (3, 4))
    out = ways_into(part, tmp_path)[way]
    before = sorted(path for path in tmp_path.rglob("*"))
    writers = (
        lambda: merge([part, part], out),
        lambda: split(part, tmp_path / "first", out, 0.5, 0),
        lambda: split(part, out, tmp_path / "second", 0.5, 0),
        lambda: salvage(part, out),
        lambda: export_minari(part, out),
        lambda: plot(part, out.with_suffix(".png")),
        lambda: record(out),
        lambda: RunFolder.create(TrainConfig("WalkerSim-v0", run_dir=out), {}),
    )
    for write in writers:
        with pytest.raises(
            DataError,
            match="is in the folder of the dataset .*my data, which holds nothing else; "
            "name another",
        ):
            write()
    assert sorted(path for path in tmp_path.rglob("*")) == before and check(part) == []


@pytest.mark.parametrize("again", ["run", "run/data", "link"])
def test_a_dataset_is_not_joined_to_itself(tmp_path: Path, again: str) -> None:
    part = record(tmp_path / "run/data", (3,))
    (tmp_path / "link").symlink_to(part)
    with pytest.raises(DataError, match=f"{again} is named twice; name it once"):
        merge([part, tmp_path / again], tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("first", "second"), [("c", "c/d"), ("c/d", "c"), ("c", "../t/c/d")])
def test_parts_are_not_within_each_other(tmp_path: Path, first: str, second: str) -> None:
    folder = tmp_path / "t"
    folder.mkdir()
    part = record(folder / "a", (3, 4))
    with pytest.raises(DataError, match="is to be within .*c; give each part a separate folder"):
        split(part, folder / first, folder / second, 0.5, 0)
    assert [path.name for path in folder.iterdir()] == ["a"]


def test_a_dataset_may_stand_beside_others_and_in_the_folder_of_a_run(tmp_path: Path) -> None:
    part = record(tmp_path / "run/data", (3, 4))
    assert len(merge([part], tmp_path / "run/joined").rows) == 2


def test_parts_and_wholes_are_told_with_their_sizes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = record(tmp_path / "a", (3, 4, 5, 1))
    most, rest, whole = (tmp_path / name for name in ("most", "rest", "whole"))
    words = [str(source), "--out", str(most), "--rest", str(rest), "--seed", "3"]
    assert main(["data", "split", *words]) == 0
    kept = load(most)
    count, steps = len(kept.rows), len(kept)
    assert count == 3, "four fifths by default"
    assert capsys.readouterr().out.splitlines() == [
        f"3 episodes, {steps} steps: {most}",
        f"1 episode, {13 - steps} step{'' if steps == 12 else 's'}: {rest}",
    ]
    assert main(["data", "merge", str(most), str(rest), "--out", str(whole)]) == 0
    assert capsys.readouterr().out == f"4 episodes, 13 steps: {whole}\n"


@pytest.mark.parametrize(
    ("share", "says"),
    [
        (-0.1, "share is -0.1; give a number between 0 and 1"),
        (1.1, "share is 1.1; give a number between 0 and 1"),
        (float("nan"), "share is nan"),
        (0.0, "a share of 0 of 4 episodes leaves one of the two empty"),
        (0.1, "a share of 0.1 of 4 episodes leaves one of the two empty"),
        (0.9, "a share of 0.9 of 4 episodes leaves one of the two empty"),
        (1.0, "a share of 1 of 4 episodes leaves one of the two empty"),
    ],
)
def test_a_share_leaves_something_for_both_parts(tmp_path: Path, share: float, says: str) -> None:
    source = record(tmp_path / "a", (1, 1, 1, 1))
    with pytest.raises(DataError, match=says):
        split(source, tmp_path / "x", tmp_path / "y", share, 0)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    for least in (0.2, 0.8):
        first, second = tmp_path / f"{least} first", tmp_path / f"{least} second"
        parts = split(source, first, second, least, 0)
        assert [len(part.rows) for part in parts] == [round(4 * least), 4 - round(4 * least)]
