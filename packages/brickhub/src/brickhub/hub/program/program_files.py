"""Files that a program on a hub writes over its output, as ``motor.log.save`` does: found in it,
and saved beside the program.

A line ``PB_OF:NAME`` or ``_file_begin_ NAME`` begins one, ``PB_EOF`` or ``_file_end_`` ends it;
what is between is its content. Programs come from others, so a name can lead neither out of the
program's folder nor to something that a computer would run.
"""

from collections.abc import Callable
from pathlib import Path, PureWindowsPath
from typing import BinaryIO

from brickhub.errors import counted
from brickhub.files import is_device_of_windows

_BEGINNINGS = (b"PB_OF:", b"_file_begin_ ")
_ENDS = (b"PB_EOF", b"_file_end_")
_MARKERS = (*_BEGINNINGS, *_ENDS)
_TABLES_AND_TEXTS = frozenset((".csv", ".dat", ".json", ".jsonl", ".log", ".md", ".tsv", ".txt"))
"""Endings of files that may be replaced."""
_RUN_BY_A_COMPUTER = frozenset(
    (
        ".app", ".bat", ".bash", ".cfg", ".cmd", ".com", ".command", ".desktop", ".dll",
        ".dylib", ".exe", ".fish", ".hta", ".inf", ".ini", ".ipynb", ".jar", ".js", ".lnk",
        ".msi", ".pl", ".pth", ".ps1", ".py", ".pyc", ".pyd", ".pyi", ".pyw", ".pyz", ".rb",
        ".reg", ".scr", ".service", ".sh", ".so", ".toml", ".url", ".vbs", ".wsf", ".zsh",
    )
)  # fmt: skip
"""Endings of files that something runs, or takes its settings from."""


class ProgramFiles:
    """Output of a program without the files in it, which are saved in a folder.

    Args:
        output: receives everything else, as it comes.
        folder: of the program; names of files are relative to it.
        tell: called with a line about each file that is saved or refused; what was to be in a
            refused one is printed.
    """

    def __init__(
        self,
        output: BinaryIO,
        folder: Path,
        tell: Callable[[str], object],
    ) -> None:
        self._output = output
        self._folder = folder
        self._tell = tell
        self._line = b""
        # This tells whether the beginning of the present line is already printed.
        self._is_printed = False
        self._file: BinaryIO | None = None
        self._name = ""
        self._line_count = 0

    def write(self, data: bytes, /) -> int:
        """Take further output. Raises OSError if the output or a file cannot be written."""
        # Pieces may end anywhere, even within a marker.
        *line_ends, beginning = data.split(b"\n")
        for line_end in line_ends:
            self._take(line_end)
            self._end_line()
        self._take(beginning)
        return len(data)

    def flush(self) -> None:
        """Hand on what the output keeps."""
        self._output.flush()

    def close(self) -> None:
        """Save what was begun, at the end of the program."""
        # The last line may lack its line end.
        if self._line and self._file is not None:
            self._end_line()
        elif self._line and not self._is_printed:
            self._output.write(self._line)
        self._line = b""
        self._end_file()
        self._output.flush()

    def _take(self, piece: bytes) -> None:
        """Add to the present line; it is printed at once where it cannot become a marker."""
        self._line += piece
        if self._is_printed:
            self._output.write(piece)
            return
        is_output = self._file is None and not _may_be_marker(self._line)
        if self._line and is_output:
            self._output.write(self._line)
            self._is_printed = True

    def _end_line(self) -> None:
        line = self._line.removesuffix(b"\r")
        is_printed = self._is_printed
        # The next line begins whatever comes of this one, because writing may raise.
        self._line = b""
        self._is_printed = False
        if is_printed:
            self._output.write(b"\n")
        # A file that lacks its end ends where the next one begins.
        elif line.startswith(_BEGINNINGS):
            self._begin_file(line)
        elif self._file is not None and line.startswith(_ENDS):
            self._end_file()
        elif self._file is not None:
            self._file.write(line + b"\n")
            self._line_count += 1
        else:
            self._output.write(line + b"\n")

    def _begin_file(self, line: bytes) -> None:
        self._end_file()
        marker = next(marker for marker in _BEGINNINGS if line.startswith(marker))
        name = line.removeprefix(marker).decode("utf-8", "replace").strip()
        problem = why_unsafe(name, self._folder)
        path = self._folder / name
        if problem is None:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                self._file = path.open("wb")
            except (OSError, ValueError) as error:
                problem = getattr(error, "strerror", None) or str(error)
        if problem is None:
            self._name = name
            self._line_count = 0
            return
        # The program chose this name, so it is shown with escapes and cut.
        shown = repr(name[:80])
        self._tell(
            f"the program's file {shown} was not saved, but printed ({problem}); choose a name "
            "such as log.csv"
        )
        self._output.write(line + b"\n")

    def _end_file(self) -> None:
        file = self._file
        if file is None:
            return
        # Closing may raise on a full disk, and must not be tried again then.
        self._file = None
        file.close()
        self._tell(f"saved {self._folder / self._name} ({counted(self._line_count, 'line')})")


def _may_be_marker(line: bytes) -> bool:
    """Whether a line that is not whole yet is a marker, or may become one."""
    return any(line.startswith(marker) or marker.startswith(line) for marker in _MARKERS)


def why_unsafe(name: str, folder: Path) -> str | None:
    """Why a program may not write a file of that name beside it, in its ``folder``; ``None`` if it
    may."""
    # Names are read as paths of Windows on every system, because these know both kinds of slashes
    # and drives. So a file that one computer accepts is accepted by all.
    windows_path = PureWindowsPath(name)
    parts = windows_path.parts
    if not parts or not name.isprintable():
        return "it is no name"
    is_absolute = windows_path.drive or name.startswith(("/", "\\", "~"))
    if is_absolute or ".." in parts:
        return "it is outside of the program's folder"
    if "\\" in name or ":" in name:
        return "it has a backslash or a colon; separate folders by /"
    if any(part.startswith(".") for part in parts):
        return "it is hidden"
    if any(is_device_of_windows(part) for part in parts):
        return "it is a device of Windows"
    # Windows ignores dots and spaces at the end of a name.
    if Path(name.rstrip(". ")).suffix.lower() in _RUN_BY_A_COMPUTER:
        return "a computer runs such files"
    path = folder / name
    # What already exists counts too: a link may lead elsewhere, and only a table or a text may be
    # replaced.
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
        if not is_inside or path.is_symlink():
            return "it is outside of the program's folder"
        if path.exists() and not path.is_file():
            return "there is something else of that name"
        if path.exists() and path.suffix.lower() not in _TABLES_AND_TEXTS:
            return "there is such a file, which is no table or text"
    except (OSError, ValueError, RuntimeError) as error:
        return getattr(error, "strerror", None) or str(error)
    return None
