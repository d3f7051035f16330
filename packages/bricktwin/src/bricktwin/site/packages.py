"""Packages of npm that the site is made of: exact versions, checked against their hashes.

They are fetched by ``npm pack`` into the user's cache, which is all that npm is used for: nothing
is installed, and no script of a package runs but the bundler's.
"""

import base64
import hashlib
import shutil
import subprocess
import tarfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from brickhub.errors import BricksError
from brickhub.files import user_cache

_TIMEOUT_S = 600.0


class SiteError(BricksError):
    """A site that cannot be made."""


@dataclass(frozen=True)
class Package:
    """One package of npm.

    Attributes:
        name: such as ``@mujoco/mujoco``.
        version: the only one that is taken.
        sha512: of its archive, in base64, as npm writes it.
    """

    name: str
    version: str
    sha512: str

    @property
    def archive(self) -> str:
        """Name that ``npm pack`` gives the archive."""
        flat = self.name.removeprefix("@").replace("/", "-")
        return f"{flat}-{self.version}.tgz"


PACKAGES = (
    # Python, physics and the hub's compiler.
    Package(
        "pyodide",
        "314.0.7",
        "0YvXxEhfEdpLfb/XkM2BFAeMROq0iMUX2bzzH9pOttyMcWkwq+HbE5uyuGD82LN7y2q+SNvi/6V5JEsOlD2R1A==",
    ),
    Package(
        "@mujoco/mujoco",
        "3.14.0",
        "WPUYidu4Fx8+uM4hQv80SOA0ifpWGrsNJguKs8JBV8SCTxjKQ2/rqsh880nUH0/Vwa8vuefghvCQkkoed3bkUg==",
    ),
    Package(
        "@pybricks/mpy-cross-v6",
        "2.0.0",
        "DJqQgpAyoUR/myQCJFl27WxXfQavVx3nYLMOpEAuxXRcYyDebHLx4fsUOhLV+vK1LfEqeBpzAjMMSh2U4Q+dtA==",
    ),
    # The editor, and what it needs.
    Package(
        "codemirror",
        "6.0.2",
        "VhydHotNW5w1UGK0Qj96BwSk/Zqbp9WbnyK2W/eVMv4QyF41INRGpjUhFJY7/uDNuudSc33a/PKr4iDqRduvHw==",
    ),
    Package(
        "@codemirror/autocomplete",
        "6.20.4",
        "yF8RhOf2SXlg00+qtupzLhrglcas61boqaONiNcbPIebHCpJocpqTBA6dyrtUrQO47hqyTdeob/3XnYilT7TaQ==",
    ),
    Package(
        "@codemirror/commands",
        "6.11.1",
        "O/4hG3SC1YwcmQ0d2UVNDs+AsaNWd1iHVxbTeEBuqH+6bExAiPK3iS/BvpY6rZGURALv4ZD3sIgcCmRvw3ehBg==",
    ),
    Package(
        "@codemirror/lang-python",
        "6.2.1",
        "IRjC8RUBhn9mGR9ywecNhB51yePWCGgvHfY1lWN/Mrp3cKuHr0isDKia+9HnvhiWNnMpbGhWrkhuWOc09exRyw==",
    ),
    Package(
        "@codemirror/language",
        "6.13.1",
        "zfvU2r3TyylQLMj/te+5CnQ0rSqZi8B1oTCBbQkagcLW4Xc6imab6qN+pEJhsuNOLaJqiRyBXp9UhWA1DhVvDw==",
    ),
    Package(
        "@codemirror/lint",
        "6.9.8",
        "qNvtcE73xUto/D1RvtgSRI4A1Hg8ekxlvtZpjHpdpisLBnhyu82EUEJMEgaxkjuQCA8vqnrylENWKOsEDCOHcw==",
    ),
    Package(
        "@codemirror/search",
        "6.7.2",
        "gUYkYhT2+n/+VGZ+8EzE5WFkYZUZYm1VOKDudIsNqh42uRVQJ0a6Yss9sdKT3MeOYfuL1N6AZA57oza0Oyr0LA==",
    ),
    Package(
        "@codemirror/state",
        "6.7.6",
        "kAz+AncRtKuIknedxT1bq4XwXv4UowhbkHU1myPrtVb/jZtImWuV5BXzv5vK6i3kYACsdiZiQKFQQ5Mq7elW8w==",
    ),
    Package(
        "@codemirror/streamparser",
        "6.0.0",
        "JTFPF6xrfjt0mnfGPgzcLiMwYmvIyNaoizp8BYzv8FE8KrT6GBGDZ190rtt+O7Wke3gG/MFHyiY9YGNeimof4w==",
    ),
    Package(
        "@codemirror/view",
        "6.43.15",
        "HHsfpqFeHyXLs983pSRe38Xajs0vFWZQ2BuX0m7Ki8w3jZ5iD8cuR3lBz2/5/X53Dhf32SBHKh6rtSTB6tKeGw==",
    ),
    Package(
        "@lezer/common",
        "1.5.5",
        "Pw7PVCndruF1pb3ebCxpSVpkMHSDjwRCLcTRw+RizUKco5QbWylwq2g4lnG/RYN7yTTQDXE9F77MwtkAyphrjg==",
    ),
    Package(
        "@lezer/highlight",
        "1.2.5",
        "O1GMVKgtf5YspFaRzpmqkVgMtIk2HG9uMAbH6wdAIdNh3TVzCsch/+cRi+6l2//UGDKe6NB9BW3cvuR5ezMQ0w==",
    ),
    Package(
        "@lezer/lr",
        "1.4.12",
        "On9HU4oMMiHPMkQDgoTnGahjgG5n/MkN38CgG77sMraKLL+3JBbeQNi1FcCXV9QRqwF9/BUXP3caHyJC1fBOTQ==",
    ),
    Package(
        "@lezer/python",
        "1.1.19",
        "MhQIURHRytsNzP/YXnqpYKW6la6voAH3kyplTOOiCdjyFY6cWWGFVmYVdHIPrElqSDf4iCDktQCockB9FxuhzQ==",
    ),
    Package(
        "@marijn/find-cluster-break",
        "1.0.4",
        "Wy0V7+SGUjnF9/TkiM1hKVDPj7jKXduPNboMVtHTA8dySMURWqfg/JZ9E2Sq8JgSJmkl7k7Qe9FLeMSrSraWmQ==",
    ),
    Package(
        "crelt",
        "1.0.7",
        "aK6BbWfhf4U/wCcLHKPJl/xa6VkVstRaPywWtMKGwuOLc/wZTyQYuoxgvZnNsBvv7Kg3YTBQYYBCggcviQczuA==",
    ),
    Package(
        "style-mod",
        "4.1.5",
        "WQ2llCZa9sZSkJA+aOwpg5DkfbAXFKGh//t3MRTBeruFiSBC+GXUmbBzrw3bXyboCWAbtCW9InDfBsXrRD/rAg==",
    ),
    Package(
        "w3c-keyname",
        "2.2.8",
        "dpojBhNsCNN7T82Tm7k26A6G9ML3NkhDsnw9n/eoxSRlVBB4CEtIQ/KTCLI2Fwf3ataSXRhYFkQi3SlnFwPvPQ==",
    ),
    # The bundler, which runs when the site is made.
    Package(
        "esbuild-wasm",
        "0.28.2",
        "GccVwhv3mmOUVQHCQm2Ox/rby8n/EqUwvZxE6Pjfikrq/lWw9g9WX/u9EykWnpot3Ko6j426DgQdea2xWKIAQA==",
    ),
)


def npm() -> str:
    """The program npm. Raises SiteError if it is not on this computer."""
    found = shutil.which("npm")
    if found is None:
        raise SiteError(
            "npm is not on this computer, which fetches what a site is made of; install Node.js "
            "(https://nodejs.org, or your system's packages nodejs and npm)"
        )
    return found


def node() -> str:
    """The program node. Raises SiteError if it is not on this computer."""
    found = shutil.which("node")
    if found is None:
        raise SiteError("node is not on this computer; install Node.js, of which npm is a part")
    return found


def unpack_packages(folder: Path) -> None:
    """Unpack all packages into ``node_modules`` of a folder. Raises SiteError."""
    cache = user_cache() / "npm"
    cache.mkdir(parents=True, exist_ok=True)
    _fetch([package for package in PACKAGES if not _is_right(cache, package)], cache)
    for package in PACKAGES:
        if not _is_right(cache, package):
            raise SiteError(
                f"what npm fetched as {package.name} {package.version} has another hash than the "
                "one that this version of bricktwin was tried with; look at npm's settings "
                "(npm config get registry), and try again"
            )
        target = folder / "node_modules" / package.name
        _unpack(cache / package.archive, target)


def _is_right(cache: Path, package: Package) -> bool:
    """Whether the cache has the very package."""
    try:
        content = (cache / package.archive).read_bytes()
    except OSError:
        return False
    digest = hashlib.sha512(content).digest()
    return base64.b64encode(digest).decode() == package.sha512


def _fetch(packages: list[Package], cache: Path) -> None:
    if not packages:
        return
    names = [f"{package.name}@{package.version}" for package in packages]
    command = [npm(), "pack", "--ignore-scripts", "--silent", "--pack-destination", str(cache)]
    try:
        done = subprocess.run(  # noqa: S603  our own words only
            [*command, *names],
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SiteError(
            f"npm has not fetched {names[0]} within {_TIMEOUT_S:g} s; look at the network, and "
            "try again"
        ) from None
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        said = lines[-1] if lines else f"it ended with status {done.returncode}"
        raise SiteError(f"npm could not fetch {', '.join(names)}: {said}; look at the network")


def _unpack(archive: Path, target: Path) -> None:
    """Unpack plain files only, and only into the target."""
    with tarfile.open(archive) as packed:
        for member in packed:
            path = PurePosixPath(member.name)
            # The first part is npm's `package`, or a name of the author's.
            inside = PurePosixPath(*path.parts[1:])
            is_safe = member.isfile() and inside.parts and ".." not in inside.parts
            if not is_safe:
                continue
            content = packed.extractfile(member)
            if content is None:
                continue
            file = target / inside
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content.read())
