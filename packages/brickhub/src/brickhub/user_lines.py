"""Lines of the user's files, where an exception was raised in them."""

import sys
import sysconfig
import traceback
from collections.abc import Iterator
from pathlib import Path

from brickhub import HOUSES


def line_of_user(error: BaseException) -> str:
    """Location in the user's files where an exception was raised, as ", my_task.py, line 7"; empty
    if there is none."""
    foreign = [folder.resolve() for folder in _foreign_folders()]
    # The innermost call comes first, because the user's last line explains more than the one that
    # began it all.
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        path = Path(frame.filename)
        # Code that was made from a text, such as a dataclass's methods, has a name like "<string>".
        if not path.is_file():
            continue
        file = path.resolve()
        if not any(file.is_relative_to(folder) for folder in foreign):
            return f", {path.name}, line {frame.lineno}"
    return ""


def _foreign_folders() -> Iterator[Path]:
    """Folders of code that is not the user's: ours, wherever it is installed, Python's, and that
    of installed packages."""
    for house in HOUSES:
        file = getattr(sys.modules.get(house), "__file__", None)
        if file:
            yield Path(file).resolve().parent
    for name in ("stdlib", "platstdlib", "purelib", "platlib", "scripts"):
        folder = sysconfig.get_path(name)
        if folder:
            yield Path(folder)
