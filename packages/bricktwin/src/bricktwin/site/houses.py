"""Archive of this project's own sources, for Python in a tab."""

import io
import zipfile
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path

import brickhub
import bricktwin
from brickhub.kits.radio import LEGO_PACKAGE, lego_package
from bricktwin.site.storing import undated

# Modules of the houses that nothing in a tab can use: they need the computer, or are not for it.
_LEFT_OUT = (
    "brickhub/cli",
    "bricktwin/cli",
    "bricktwin/measure",
    "bricktwin/plans",
    "bricktwin/site/programs",
    "bricktwin/site/static",
    "bricktwin/site/worker",
    "bricktwin/twin/render",
    "bricktwin/view",
)


def houses() -> bytes:
    """Archive of the sources of brickhub and bricktwin, as they are installed here."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in _sources():
            archive.writestr(undated(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def kit_package() -> bytes:
    """Archive, not compressed, of LEGO's package for its kits, as it is installed here: its
    sources, and its licence, which goes with each copy. Raises MediumUnavailableError if it is not
    installed."""
    lego_package()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for file in distribution(LEGO_PACKAGE).files or ():
            is_wanted = file.suffix == ".py" or file.name in ("LICENSE", "METADATA")
            if is_wanted:
                archive.writestr(undated(file.as_posix()), file.read_binary())
    return packed.getvalue()


def _sources() -> Iterator[tuple[str, bytes]]:
    """Name and content of each source."""
    for house in (brickhub, bricktwin):
        top = Path(str(house.__file__)).parent
        for path in sorted(top.rglob("*.py")):
            name = path.relative_to(top.parent).as_posix()
            if not name.startswith(_LEFT_OUT):
                yield name, path.read_bytes()
