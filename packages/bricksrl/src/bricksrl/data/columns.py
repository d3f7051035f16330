"""Columns of steps as bytes: Parquet files, lossless videos of images (H.264 in RGB), and LeRobot's
statistics."""

import hashlib
import io
import subprocess
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from brickhub.files import parsing, reading
from bricksrl.data.schema import Description
from bricksrl.errors import DataError

RESTORE = (
    "restore it from a copy, or save the intact episodes with `bricksrl data repair DIR --out NEW`"
)
"""What to do about a damaged file of episodes."""

Columns = Mapping[str, NDArray[Any]]
"""Arrays ``[steps]`` and ``[steps, n]`` by the names of the columns."""

Statistics = tuple[NDArray[np.float64], int]
"""Minimum, maximum, mean and deviation of a column, ``[4, n]``, or ``[4, 3, 1, 1]`` of images, and
the number of values."""
STATISTICS = ("min", "max", "mean", "std")
_QUIET = ("-hide_banner", "-loglevel", "error")
# H.264 in RGB with a quantiser of 0 is lossless, so what is learned from equals what was seen to
# the last bit. With a key frame at every second image, each image is quick to reach, because
# LeRobot draws them at random.
_LOSSLESS = (
    "-c:v",
    "libx264rgb",
    "-crf",
    "0",
    "-preset",
    "veryfast",
    "-g",
    "2",
    "-movflags",
    "+faststart",
)
# A file from elsewhere may be a playlist in disguise, which names other files and servers.
_ONE_MP4_FILE = ("-protocol_whitelist", "file", "-f", "mp4")


def arrow_types(description: Description) -> dict[str, tuple[int, pa.DataType]]:
    """Length and type of each column that is stored in Parquet."""
    types = {}
    for name, feature in description.features.items():
        if feature["dtype"] != "video":
            types[name] = feature["shape"][0], pa.from_numpy_dtype(feature["dtype"])
    return types


def to_parquet(table: pa.Table) -> bytes:
    """Bytes of a Parquet file, with page checksums to detect damage."""
    sink = io.BytesIO()
    pq.write_table(
        table,
        sink,
        compression="snappy",
        write_page_checksum=True,
    )
    return sink.getvalue()


def read_bytes(path: Path, remedy: str = "restore it from a copy") -> bytes:
    """Content of a file. Raises DataError, with the remedy, if it cannot be read."""
    with reading("the file", path, DataError, remedy):
        return path.read_bytes()


def read_verified(path: Path, digest: str | None) -> bytes:
    """Content of a file, of this SHA-256 ``digest`` unless ``None``. Raises DataError if it cannot
    be read or differs."""
    data = read_bytes(path, "restore it, or run `bricksrl data repair`")
    if digest is not None and hashlib.sha256(data).hexdigest() != digest:
        raise DataError(f"{path} is damaged: its content is not what was written; {RESTORE}")
    return data


def read_parquet(path: Path, *, digest: str | None = None) -> pa.Table:
    """Read a table that `to_parquet` wrote, of this SHA-256 ``digest`` if given. Nothing in the
    file is executed. Raises DataError if the file is missing or damaged."""
    data = read_verified(path, digest)
    with parsing(DataError(f"{path} is not a valid Parquet file; {RESTORE}")):
        file = pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True)
        if file.metadata.num_rows > len(data):
            raise DataError(
                f"{path} claims more rows than it can hold; it is damaged or not ours; {RESTORE}"
            )
        # Arrow uses no threads here, because one that lets go of `data` while Python exits aborts
        # the program.
        table = file.read(use_threads=False)
        table.validate(full=True)
    return table


def to_table(columns: Columns, description: Description) -> pa.Table:
    """Arrow table of the columns, in the layout of the data files."""
    arrays = {}
    for name, (n, type_) in arrow_types(description).items():
        flat = pa.array(columns[name].reshape(-1), type_)
        arrays[name] = flat if n == 1 else pa.FixedSizeListArray.from_arrays(flat, n)
    return pa.table(arrays)


def from_table(
    table: pa.Table,
    description: Description,
    names: Iterable[str],
    where: Path,
) -> dict[str, NDArray[Any]]:
    """Inverse of `to_table` for some of the columns; vectors of length 1 are returned as
    ``[steps]``. Raises DataError if a column has another type than in the description."""
    types = arrow_types(description)
    arrays = {}
    for name in names:
        n, type_ = types[name]
        try:
            column = table[name].combine_chunks()
        except KeyError:
            raise DataError(
                f"{where} has not one column {name}; it is not a file of this dataset"
            ) from None
        expected = type_ if n == 1 else pa.list_(type_, n)
        # Other programs write lists of any length, so the lengths are checked below.
        is_list = pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type)
        is_other_list = n > 1 and is_list and column.type.value_type == type_
        fits = column.type == expected or is_other_list
        if not fits or column.null_count:
            raise DataError(
                f"{where}: column {name} is {column.type}, not {expected}; it is not a file of "
                "this dataset"
            )
        flat = column if n == 1 else column.flatten()
        if len(flat) != n * len(column) or flat.null_count:
            raise DataError(
                f"{where}: column {name} has rows of another length than {n}; it is not a file of "
                "this dataset"
            )
        values = flat.to_numpy(zero_copy_only=False)
        arrays[name] = values if n == 1 else values.reshape(-1, n)
    return arrays


def column_statistics(values: NDArray[Any]) -> Statistics:
    """Statistics of the column of one episode."""
    rows = np.asarray(values, np.float64).reshape(len(values), -1)
    # A clock that is missing reads NaN, about which NumPy would warn.
    with np.errstate(invalid="ignore"):
        return np.stack((rows.min(0), rows.max(0), rows.mean(0), rows.std(0))), len(rows)


def image_statistics(images: NDArray[np.uint8]) -> Statistics:
    """Statistics of images ``[steps, height, width, 3]`` per colour in 0..1."""
    values, _ = column_statistics(images.reshape(-1, 3) / 255.0)
    return values.reshape(-1, 3, 1, 1), len(images)


def join_statistics(parts: Sequence[dict[str, Statistics]]) -> dict[str, dict[str, list[Any]]]:
    """Statistics of all episodes together, by column and name as in LeRobot, from those of each
    episode."""
    joined = {}
    for name in parts[0] if parts else ():
        values = np.array([part[name][0] for part in parts])  # [episodes, 4, ...]
        counts = np.array([part[name][1] for part in parts])  # [episodes]
        low, high, means, stds = values.swapaxes(0, 1)  # each [episodes, ...]
        share = (counts / counts.sum()).reshape(-1, *[1] * (means.ndim - 1))
        mean = (share * means).sum(0)
        # By the law of total variance, this adds the variance within the episodes and the variance
        # of their means.
        within = stds**2
        between = (means - mean) ** 2
        variance = (share * (within + between)).sum(0)
        found = (low.min(0), high.max(0), mean, np.sqrt(variance))
        joined[name] = {stat: value.tolist() for stat, value in zip(STATISTICS, found, strict=True)}
        joined[name]["count"] = [int(counts.sum())]
    return joined


def encode(images: NDArray[np.uint8], rate_hz: float) -> bytes:
    """Encode images ``[steps, height, width, 3]`` losslessly as an mp4 file, the inverse of
    `decode`. Raises DataError if ffmpeg is not installed, or it failed."""
    _, height, width, _ = images.shape
    raw = (
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{width}x{height}",
        "-r",
        str(rate_hz),
        "-i",
        "pipe:0",
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        command = [_ffmpeg(), *_QUIET, *raw, *_LOSSLESS, str(path)]
        process = subprocess.run(  # noqa: S603
            command,
            input=images.tobytes(),
            capture_output=True,
            check=False,
        )
        if process.returncode:
            raise DataError(
                "ffmpeg could not write a video: "
                f"{process.stderr.decode(errors='replace').strip()}; install another"
            )
        return path.read_bytes()


def decode(
    path: Path,
    count: int,
    side: int,
) -> NDArray[np.uint8]:
    """Decode the first ``count`` images of a file, ``[count, side, side, 3]``. Raises DataError if
    the file is no such video, or too short."""
    size_bytes = count * side * side * 3
    # One byte more than wanted is read, by which a video of larger images is recognised.
    raw = ("-frames:v", str(count), "-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1")
    command = [_ffmpeg(), *_QUIET, "-nostdin", *_ONE_MP4_FILE, "-i", f"file:{path}", *raw]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:  # noqa: S603
        data = b"" if process.stdout is None else process.stdout.read(size_bytes + 1)
        process.kill()
    if len(data) != size_bytes:
        raise DataError(f"{path} is not a video of {count} images of {side} x {side} px; {RESTORE}")
    return np.frombuffer(data, np.uint8).reshape(
        count,
        side,
        side,
        3,
    )


def _ffmpeg() -> str:
    import imageio_ffmpeg

    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError:
        raise DataError(
            "there is no ffmpeg for videos; reinstall imageio-ffmpeg: pip install imageio-ffmpeg"
        ) from None
