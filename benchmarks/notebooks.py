"""Tutorials with their outputs: executes the notebooks of the documentation and stores what they
show.

    python -m benchmarks notebooks          # all
    python -m benchmarks notebooks 2 6      # some

Each runs in a kernel and an empty folder of its own, and is written back to ``docs/tutorials`` with
its films made smaller and a digest of its code, by which a test sees that the outputs are those of
today's cells. An error of a cell ends it.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import subprocess
import tempfile
from pathlib import Path

import imageio_ffmpeg
import nbclient
import nbformat

from benchmarks.session import Session

FOLDER = Path(__file__).parents[1] / "docs" / "tutorials"
_EMBEDDED = re.compile(r'(?<=data:video/mp4;base64,)[^"]+')
_FILM = (
    "-an",
    "-c:v",
    "libx264",
    "-crf",
    "37",
    "-preset",
    "veryslow",
    "-pix_fmt",
    "yuv420p",
    "-movflags",
    "+faststart",
)


def digest(notebook: nbformat.NotebookNode) -> str:
    """A digest of all code cells."""
    sources = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return hashlib.sha256("\0".join(sources).encode()).hexdigest()[:16]


def smaller(film: bytes) -> bytes:
    """An mp4 film with fewer bits for each image."""
    with tempfile.TemporaryDirectory() as folder:
        before, after = Path(folder) / "before.mp4", Path(folder) / "after.mp4"
        before.write_bytes(film)
        command = [
            imageio_ffmpeg.get_ffmpeg_exe(),
            "-v",
            "error",
            "-i",
            str(before),
            *_FILM,
            str(after),
        ]
        subprocess.run(command, check=True)  # noqa: S603 - our own arguments
        return after.read_bytes()


def execute(notebook: nbformat.NotebookNode) -> None:
    """Execute a notebook in place. Raises CellExecutionError if a cell fails, also one that may
    fail without graphics."""
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    with tempfile.TemporaryDirectory() as folder:
        client = nbclient.NotebookClient(
            notebook,
            timeout=None,
            kernel_name="python3",
            resources={"metadata": {"path": folder}},
            record_timing=False,
        )
        client.force_raise_errors = True
        # TorchRL logs to the standard output
        client.execute(env={**os.environ, "RL_LOGGING_LEVEL": "WARNING"})
    store(notebook)


def store(notebook: nbformat.NotebookNode) -> None:
    """Make the outputs of a notebook fit for storing: small films, nothing that the kernel says of
    this machine."""
    for cell in (cell for cell in notebook.cells if cell.cell_type == "code"):
        cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
        for data in (
            output.data for output in cell.outputs if "text/html" in output.get("data", {})
        ):
            data["text/html"] = _EMBEDDED.sub(
                lambda film: base64.b64encode(smaller(base64.b64decode(film[0]))).decode(),
                data["text/html"],
            )
    notebook.metadata["executed"] = digest(notebook)


def main(session: Session) -> None:
    """Execute the notebooks and write them."""
    session.parser.add_argument(
        "numbers", nargs="*", metavar="NUMBER", help="of the tutorials (default: all)"
    )
    numbers = session.parse().numbers
    for path in sorted(FOLDER.glob("*.ipynb")):
        if not numbers or path.name[0] in numbers:
            notebook = nbformat.read(path, 4)  # type: ignore[no-untyped-call]
            execute(notebook)
            nbformat.write(notebook, session.place_of(FOLDER) / path.name)  # type: ignore[no-untyped-call]
            print(
                f"{path.stem}: "
                f"{(session.place_of(FOLDER) / path.name).stat().st_size / 1000:.0f} kB",
                flush=True,
            )
