from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pyarrow.parquet as pq
import pytest
from forked import ForkServer, Scratch
from toy_data import SEEING, TOY, record, record_episode, steps

from brickhub.entry import Entry
from bricksrl.data import About, Recorder, load
from bricksrl.data.columns import encode
from bricksrl.data.integrity import check
from bricksrl.errors import DataError


def test_recorded_equals_read(tmp_path: Path) -> None:
    episodes = load(record(tmp_path / "set", (3, 5)))
    wanted = [*steps(0, 3), *steps(1, 5)]
    assert len(episodes) == 8
    for name in ("observation", "action", "next_observation"):
        assert np.array_equal(
            getattr(episodes, name).numpy(),
            np.stack([np.asarray(getattr(step, name)) for step in wanted]),
        )
    for name in ("reward", "terminated", "truncated", "intervention", "age_s", "hub_time_s"):
        ours = getattr(episodes, name).numpy()
        assert np.array_equal(
            ours, np.array([getattr(step, name) for step in wanted], ours.dtype)
        ), name
    assert episodes.episode.tolist() == [0] * 3 + [1] * 5
    assert [row.return_ for row in episodes.rows] == pytest.approx(
        [sum(step.reward for step in steps(k, n)) for k, n in ((0, 3), (1, 5))], rel=1e-6
    )
    assert [(row.about.seed, row.about.policy, row.about.success) for row in episodes.rows] == [
        (0, "random", True),
        (1, "random", False),
    ]


def test_transitions_have_torchrl_layout(tmp_path: Path) -> None:
    episodes = load(record(tmp_path / "set", (3, 5), SEEING))
    data = episodes.to_tensordict()
    assert data.batch_size == (8,)
    assert np.array_equal(data["next", "observation"], episodes.next_observation)
    assert np.array_equal(data["next", "image"], episodes.next_image)
    assert data["next", "done"].shape == (8, 1) and data[
        "next", "done"
    ].flatten().nonzero().flatten().tolist() == [2, 7]


def test_images_survive_round_trip(tmp_path: Path) -> None:
    episodes = load(record(tmp_path / "set", (3, 4), SEEING))
    wanted = [*steps(0, 3, SEEING), *steps(1, 4, SEEING)]
    assert episodes.image is not None and episodes.next_image is not None
    assert np.array_equal(
        episodes.image.numpy(), np.stack([step.image for step in wanted if step.image is not None])
    )
    assert np.array_equal(
        episodes.next_image.numpy(),
        np.stack([step.next_image for step in wanted if step.next_image is not None]),
    )
    assert load(tmp_path / "set", images=False).image is None


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such names")
def test_name_with_a_colon_is_no_protocol_of_the_video(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert load(record(Path("walker:1"), (3,), SEEING)).image is not None


@pytest.mark.parametrize("step_ms", [91, 250, 300])
def test_times_of_a_long_video_are_those_of_the_steps(tmp_path: Path, step_ms: int) -> None:
    """Within LeRobot's tolerance."""
    (tmp_path / "video.mp4").write_bytes(
        encode(np.zeros((2000, 16, 16, 3), np.uint8), 1000 / step_ms)
    )
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(),
        "-i",
        str(tmp_path / "video.mp4"),
        "-vf",
        "showinfo",
        "-f",
        "null",
        "-",
    ]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    times_s = [float(text) for text in re.findall(r"pts_time:(\S+)", told)]
    assert len(times_s) == 2000 and times_s[-1] == pytest.approx(1.999 * step_ms, abs=1e-4)


def test_the_layout_is_that_of_lerobot(tmp_path: Path) -> None:
    root = record(tmp_path / "set", (3, 5), SEEING)
    info = json.loads((root / "meta/info.json").read_text())
    assert (
        info["codebase_version"],
        info["fps"],
        info["total_episodes"],
        info["total_frames"],
    ) == ("v3.0", 4, 2, 8)
    assert info["features"]["observation.state"] == {
        "dtype": "float32",
        "shape": [2],
        "names": ["angle", "distance"],
    }
    assert info["features"]["observation.images.webcam"]["dtype"] == "video"
    table = pq.read_table(root / "data/chunk-000/file-001.parquet")
    numbers = [name for name, feature in info["features"].items() if feature["dtype"] != "video"]
    assert table.column_names == numbers
    assert table["index"].to_pylist() == [3, 4, 5, 6, 7] and table["frame_index"].to_pylist() == [
        0,
        1,
        2,
        3,
        4,
    ]
    assert table["timestamp"].to_pylist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    rows = pq.read_table(root / "meta/episodes/chunk-000/file-001.parquet").to_pylist()
    assert [
        (row["episode_index"], row["length"], row["dataset_from_index"], row["dataset_to_index"])
        for row in rows
    ] == [(1, 5, 3, 8)]
    assert (rows[0]["data/chunk_index"], rows[0]["data/file_index"], rows[0]["tasks"]) == (
        0,
        1,
        ["Toy-v0"],
    )
    assert (
        root
        / info["video_path"].format(
            video_key="observation.images.webcam", chunk_index=0, file_index=1
        )
    ).exists()
    assert pq.read_table(root / "meta/tasks.parquet").to_pandas().loc["Toy-v0", "task_index"] == 0


def test_statistics_cover_all_steps(tmp_path: Path) -> None:
    root = record(tmp_path / "set", (3, 5, 4))
    stats = json.loads((root / "meta/stats.json").read_text())
    every = load(root)
    for name, values in (
        ("observation.state", every.observation),
        ("next.reward", every.reward[:, None]),
    ):
        array = values.numpy().astype(np.float64)
        wanted = {
            "min": array.min(0),
            "max": array.max(0),
            "mean": array.mean(0),
            "std": array.std(0),
            "count": [12],
        }
        for key, value in wanted.items():
            assert stats[name][key] == pytest.approx(np.asarray(value).tolist()), (name, key)


def test_recording_continues(tmp_path: Path) -> None:
    record(tmp_path / "set", (3, 5))
    record(tmp_path / "set", (4,), first_seed=2)
    together = load(record(tmp_path / "other", (3, 5, 4)))
    apart = load(tmp_path / "set")
    assert np.array_equal(apart.observation, together.observation) and np.array_equal(
        apart.episode, together.episode
    )


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (replace(TOY, robot={"name": "walker"}), "robot walker instead of toy"),
        (
            replace(TOY, robot={"name": "toy", "motors": []}),
            "robot toy: the same name with another description",
        ),
        (replace(TOY, rate_hz=10.0), "rate_hz 10.0 instead of 4.0"),
        (replace(TOY, env="Other-v0"), "env Other-v0 instead of Toy-v0"),
        (replace(TOY, options={"sparse": True}), "options"),
        (
            replace(TOY, observation=TOY.observation[:1]),
            r"observation \[angle\] instead of \[angle, distance\]",
        ),
        (
            replace(TOY, action=(Entry("motor", -100.0, 100.0, "mm"),)),
            "another unit or range of motor",
        ),
        (SEEING, "camera webcam instead of None"),
    ],
)
def test_recording_other_kind_raises_with_difference(tmp_path: Path, other, named) -> None:
    root = record(tmp_path / "set")
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    with pytest.raises(DataError, match=named):
        Recorder(root, other)
    assert {path: path.read_bytes() for path in root.rglob("*") if path.is_file()} == before
    record(root, (2,), first_seed=3)  # the folder was let go of


def test_foreign_folder_is_unchanged(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters/love.txt").write_text("dear")
    with pytest.raises(DataError, match="something else"):
        Recorder(tmp_path / "letters", TOY)
    with pytest.raises(DataError, match="is a file"):
        Recorder(tmp_path / "letters/love.txt", TOY)
    (tmp_path / "lerobot/meta").mkdir(parents=True)
    (tmp_path / "lerobot/meta/info.json").write_text('{"codebase_version": "v3.0"}')
    with pytest.raises(DataError, match="was not made by BricksRL"):
        Recorder(tmp_path / "lerobot", TOY)


def test_single_recorder_at_a_time(processes: ForkServer | Scratch, tmp_path: Path) -> None:
    root = record(tmp_path / "set")
    script = f"""
import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from bricksrl.data import Recorder
from bricksrl.errors import DataError
from toy_data import TOY
try:
    Recorder(Path({str(root)!r}), TOY)
except DataError as error:
    print(error)
"""
    with Recorder(root, TOY):
        said = processes.run((), tmp_path, os.environ, 60.0, script)
    assert said.returncode == 0, said.stderr
    assert "another program writes into" in said.stdout


def test_recording_joins_a_dataset_that_another_one_began_meanwhile(tmp_path: Path) -> None:
    late, other = Recorder(tmp_path / "set", TOY), Recorder(tmp_path / "set", SEEING)
    record(tmp_path / "set", (3, 4))
    with late:
        record_episode(late, 5, 2)
    assert [row.length for row in load(tmp_path / "set").rows] == [3, 4, 2] and check(
        tmp_path / "set"
    ) == []
    with pytest.raises(DataError, match="holds other data: camera webcam"), other:
        record_episode(other, 6, 2)


def test_aborted_episode_is_marked(tmp_path: Path) -> None:
    with Recorder(tmp_path / "set", TOY) as recorder:
        record_episode(recorder, 0, 4)
        recorder.write(steps(1, 9)[:2], About())
    episodes = load(tmp_path / "set")
    assert [(row.length, row.about.whole) for row in episodes.rows] == [(4, True), (2, False)]
    assert episodes.truncated.tolist() == [False, False, False, True, False, True]


def test_unwritable_index_loses_no_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    recorder = Recorder(tmp_path / "set", TOY)
    record_episode(recorder, 0, 4)
    with monkeypatch.context() as patched:
        patched.setattr("bricksrl.data.dataset.Dataset.write_index", full)
        with pytest.raises(OSError, match="No space"):
            record_episode(recorder, 1, 3)
    record_episode(recorder, 2, 2)
    recorder.close()
    assert [row.length for row in load(tmp_path / "set").rows] == [4, 3, 2]
    assert check(tmp_path / "set") == []


def test_empty_recording_leaves_no_files(tmp_path: Path) -> None:
    with Recorder(tmp_path / "set", TOY) as recorder:
        recorder.write([], About())
    assert not (tmp_path / "set").exists()


def test_missing_image_raises(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "set", SEEING)
    with pytest.raises(DataError, match="a step has none"):
        recorder.write(steps(0, 1), About())


def test_closed_recorder_writes_nothing(tmp_path: Path) -> None:
    """Without its lock it would overwrite what another one writes."""
    with Recorder(tmp_path / "set", TOY) as first:
        record_episode(first, 0, 3)
    with Recorder(tmp_path / "set", TOY) as second:
        with pytest.raises(DataError, match="the recorder of .* is closed; make another one"):
            record_episode(first, 1, 4)
        record_episode(second, 2, 5)
        first.close()
    assert [row.length for row in load(tmp_path / "set").rows] == [3, 5] and check(
        tmp_path / "set"
    ) == []


def test_recorder_that_was_closed_before_its_first_episode_makes_no_dataset(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "set", TOY)
    recorder.close()
    with pytest.raises(DataError, match="is closed"):
        record_episode(recorder, 0, 3)
    assert not (tmp_path / "set").exists()
