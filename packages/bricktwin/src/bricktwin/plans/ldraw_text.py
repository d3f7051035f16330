"""Texts of LDraw files: of a plan, also from inside Studio's zip, and of the files beside it that
it names. All sizes are bounded."""

import codecs
import io
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from brickhub.errors import PlanError

MAX_BYTES = 8_000_000
"""Size of a file, also when it is unpacked."""
MAX_LINES = 100_000
"""Number of lines of a file."""
MAX_FILES = 500
"""Number of files that a plan may be made of."""
_STUDIO_MODELS = ("model.ldr", "model2.ldr")
"""The model in a file of Studio, under the names that it has there, the preferred one first."""
_SUFFIXES = (".ldr", ".mpd", ".dat")
"""Suffixes that a file beside a plan may have."""
_FIRST_NAME_WORD = 14
"""Index of the first word of the name in a line that places something. Before it are the 1, the
colour and 12 numbers."""


def read_text(path: Path) -> str:
    """Text of an LDraw file, also from inside Studio's zip. Raises PlanError if the file is
    missing, too large or encrypted."""
    try:
        with path.open("rb") as file:
            # Reading one byte more than is allowed recognises a file that is too large, without
            # reading all of it.
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise unread(path, error) from None
    # The first bytes tell a Studio file, which is a zip, whatever its name is.
    if data[:2] == b"PK" and len(data) <= MAX_BYTES:
        data = _unzipped(path, data)
    if len(data) > MAX_BYTES:
        raise PlanError(
            f"{path} has more than {MAX_BYTES // 1_000_000} MB; a plan is smaller, so give the "
            "model without its renderings"
        )
    is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    encoding = "utf-16" if is_wide else "utf-8-sig"
    # An older encoding spoils some letters of titles and notes, but no numbers and no part names.
    text = data.decode(encoding, errors="replace")
    if "\0" in text[:4096]:
        raise PlanError(
            f"{path} is not a text file; export the model as an LDraw file (.ldr or .mpd)"
        )
    return text


def unread(path: Path, error: OSError) -> PlanError:
    """The error for a plan that cannot be read. A path that is relative is looked for in the
    present folder, not beside the file that names it, so the folder is named."""
    where = ""
    if isinstance(error, FileNotFoundError) and not path.is_absolute():
        where = f" in {Path.cwd()}"
    reason = error.strerror or str(error)
    return PlanError(f"{path}: {reason}{where}; name an LDraw file (.ldr, .mpd or .io)")


def _unzipped(path: Path, data: bytes) -> bytes:
    """The model inside a Studio file."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            models = [
                member for member in archive.namelist() if member.lower().endswith((".ldr", ".mpd"))
            ]
            name = min(models, key=_rank, default=None)
            # The lowest flag bit of a zip member says that it is encrypted, and then it cannot be
            # read.
            if name is not None and not archive.getinfo(name).flag_bits & 1:
                with archive.open(name) as file:
                    # No more than the limit is read, whatever size the archive claims.
                    return file.read(MAX_BYTES + 1)
    except Exception as error:  # noqa: BLE001 - each method of compression has errors of its own
        raise PlanError(
            f"{path} is a damaged zip ({error}); save it again, or export an LDraw file"
        ) from None
    if name is None:
        raise PlanError(f"{path} has no model.ldr; export the model from Studio as an LDraw file")
    raise PlanError(f"{path} is encrypted by Studio; open it there and export it as an LDraw file")


def _rank(member: str) -> int:
    """Rank of a member of a Studio file among those that may be the model."""
    name = key_of(member).rpartition("/")[2]
    return (*_STUDIO_MODELS, name).index(name)


def key_of(name: str) -> str:
    """Key for comparing file names."""
    return name.replace("\\", "/").lower()


class Beside:
    """The files beside a plan, and in the folders below its own, by the names that models are
    placed by.

    Upper and lower case are equal, and so are both slashes, as for the programs that write such
    names. Nothing outside of the plan's folder is found, also not by links.
    """

    def __init__(self, plan: Path) -> None:
        self._folder = plan.parent
        self._listings: dict[Path, dict[str, Path]] = {}

    def find(
        self,
        name: str,
        user: Path,
    ) -> Path | None:
        """The file of that name beside the file that uses it, or beside the plan; ``None`` if there
        is none."""
        steps = PurePosixPath(name.replace("\\", "/")).parts
        # A path from the root, or with a drive of Windows, does not name a file beside the plan.
        is_relative = bool(steps) and steps[0] != "/" and ":" not in steps[0]
        if not (is_relative and name.lower().endswith(_SUFFIXES)):
            return None
        for folder in (user.parent, self._folder):
            path = self._walked(folder, steps)
            if path is not None and path.is_file() and self._is_within(path):
                return path
        return None

    def _walked(
        self,
        folder: Path,
        steps: Sequence[str],
    ) -> Path | None:
        """The path that is reached from a folder by some steps; ``None`` if one of them is not
        there."""
        path = folder
        for step in steps:
            member = self._member(path, step)
            if member is None:
                return None
            path = member
        return path

    def _is_within(self, path: Path) -> bool:
        """Whether a file is in the plan's folder, or below it."""
        # Both paths are resolved, because steps may go up and links may lead anywhere.
        return path.resolve().is_relative_to(self._folder.resolve())

    def _member(
        self,
        folder: Path,
        name: str,
    ) -> Path | None:
        """A member of a folder; the exact name counts before one in other letters."""
        if name == "..":
            # `parent` only cuts off the last name, which is wrong for `.` and `..`.
            return folder.parent if folder.name not in ("", "..") else folder / name
        if folder not in self._listings:
            self._listings[folder] = _listed(folder)
        listing = self._listings[folder]
        return listing.get(name) or listing.get(_plain(name))


def _listed(folder: Path) -> dict[str, Path]:
    """The members of a folder, by their names and by their plain names."""
    try:
        # Names that differ in upper and lower case only are one key. Going from the last to the
        # first keeps the first of them, on every file system.
        members = sorted(folder.iterdir(), reverse=True)
    except OSError:
        # The folder does not exist, or may not be read.
        members = []
    listing = {_plain(path.name): path for path in members}
    # Exact names are entered last, because they must replace the lower-case ones.
    listing.update({path.name: path for path in members})
    return listing


def _plain(name: str) -> str:
    """A name in lower case, with one space in place of several, because splitting a line loses the
    others."""
    return " ".join(name.split()).lower()


def named_files(text: str) -> Iterator[str]:
    """Names of the files that the lines of a text place, each once, and that are not in it."""
    inside = set()
    # A dictionary keeps each name once, in the order of the lines.
    placed = {}
    for line in text.splitlines():
        words = line.split()
        if words[:2] == ["0", "FILE"]:
            inside.add(key_of(unquoted(words[2:])))
        elif words[:1] == ["1"] and len(words) > _FIRST_NAME_WORD:
            name = unquoted(words[_FIRST_NAME_WORD:])
            placed[key_of(name)] = name
    # Only the last line tells which names are outside, because a model may be placed before its own
    # lines come.
    return (name for key, name in placed.items() if key not in inside)


def unquoted(words: Sequence[str]) -> str:
    """The name of a file; some editors quote names with spaces."""
    return " ".join(words).strip('"')


def sources_of(path: Path) -> Iterator[bytes]:
    """Contents of a plan and of the files beside it that it is made of. Raises OSError if one
    cannot be read, PlanError if one is no LDraw file."""
    waiting = [path]
    # Paths are resolved, because two names may lead to one file, and files may place each other in
    # a circle.
    known = {path.resolve()}
    beside = Beside(path)
    while waiting and len(known) <= MAX_FILES:
        file = waiting.pop()
        # The name is part of the digest, because it may be the title of the plan.
        yield file.name.encode()
        yield file.read_bytes()
        for name in named_files(read_text(file)):
            found = beside.find(name, file)
            if found is None or found.resolve() in known:
                continue
            known.add(found.resolve())
            waiting.append(found)
