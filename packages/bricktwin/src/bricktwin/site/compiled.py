"""Archives of Python's modules for a tab: its library and our houses, in which what each start
imports is compiled already, by the very Python of the tab."""

import re
import subprocess
import zipfile
from pathlib import Path

from bricktwin.site.packages import SiteError, node
from bricktwin.site.storing import pack, undated

SCRIPT = Path(__file__).parent / "compile_python.mjs"
LIBRARY = "python_stdlib.zip"
HOUSES = "houses.zip"
_NEVER_ASKED = re.compile(
    "(unittest|xmlrpc|wsgiref|pydoc|pydoc_data|ensurepip|venv|idlelib|tkinter|turtle|sqlite3|dbm|"
    "curses|multiprocessing|_pyrepl|mailbox|imaplib|smtplib|poplib|ftplib|doctest|pdb|bdb|"
    "pickletools|plistlib|optparse|_pydatetime|_pydecimal|cProfile|profile|pstats|trace|zipapp|"
    "webbrowser|netrc|modulefinder|xml|zoneinfo|statistics|email|http|ctypes|_pyio|argparse|"
    "configparser|tarfile)(/|[.]py)|encodings/(?!__init__|aliases|ascii|latin_1|utf_8|cp437)"
)
"""Modules of Python that a site leaves out: interfaces to what no tab has, tools of developers,
alphabets that are not Unicode."""


def write_archives(
    pyodide: Path,
    houses: bytes,
    work: Path,
    target: Path,
) -> None:
    """Write the archives into a folder, which is made.

    Args:
        pyodide: package of Python for browsers.
        houses: archive of our own sources.
        work: folder for what is made meanwhile.

    Raises:
        SiteError: they cannot be compiled.
    """
    _write_library(pyodide / LIBRARY, work / LIBRARY)
    (work / HOUSES).write_bytes(houses)
    compiled = work / "compiled"
    compiled.mkdir()
    done = subprocess.run(  # noqa: S603  our own words only
        [node(), SCRIPT, pyodide, work / LIBRARY, work / HOUSES, compiled],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        said = done.stderr.strip().splitlines()[-1:] or [f"status {done.returncode}"]
        raise SiteError(f"Python's modules for the tab cannot be compiled: {said[0]}")
    (target / "pyodide").mkdir(parents=True)
    pack(compiled / LIBRARY, target / "pyodide")
    pack(compiled / HOUSES, target)


def _write_library(archive: Path, target: Path) -> None:
    """Python's library without compression, as a whole it becomes smaller; and without modules of
    which nothing in a tab is known to ask."""
    with zipfile.ZipFile(archive) as packed, zipfile.ZipFile(target, "w") as plain:
        for name in packed.namelist():
            if not _NEVER_ASKED.match(name):
                plain.writestr(undated(name), packed.read(name))
