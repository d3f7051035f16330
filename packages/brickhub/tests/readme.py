"""Reading of a README: its commands, its files, and what it says that is printed."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Readme:
    """A README of one of our packages, whose program is ``prog``."""

    path: Path
    prog: str

    @property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8")

    def blocks(self, *languages: str) -> list[str]:
        """Code blocks of these languages."""
        return re.findall(
            rf"^```(?:{'|'.join(languages)})\n(.*?)^```", self.text, re.MULTILINE | re.DOTALL
        )

    def write_files(self, folder: Path) -> list[str]:
        """Write the blocks that begin with the name of their file, as ``# main.py`` or ``#
        main.csv: ...``."""
        names = []
        for block in self.blocks("python", "text"):
            if name := re.match(r"# ([\w/]+\.\w+)(:.*)?\n", block):
                (folder / name[1]).write_text(block, encoding="utf-8")
                names.append(name[1])
        return names

    @property
    def commands(self) -> list[list[str]]:
        """Arguments of the commands in blocks, without redirections."""
        lines = [line for block in self.blocks("bash") for line in block.splitlines()]
        return [
            shlex.split(line.partition(" > ")[0], comments=True)[1:]
            for line in lines
            if line.startswith(f"{self.prog} ")
        ]

    @property
    def listed(self) -> list[list[str]]:
        """Arguments of the commands in tables."""
        return [shlex.split(line) for line in re.findall(rf"`{self.prog} ([^`]+)` \|", self.text)]

    @property
    def consoles(self) -> list[tuple[list[str], str]]:
        """Arguments of the commands whose output is shown, and that output."""
        found = re.findall(
            rf"^\$ {self.prog} (.*)\n((?:(?!\$ ).*\n)*)",
            "".join(self.blocks("console")),
            re.MULTILINE,
        )
        return [(shlex.split(line, comments=True), output) for line, output in found]


def needs_a_hub(words: list[str]) -> bool:
    """Whether a command is for a real hub, or for this computer's Bluetooth."""
    asks_for_it = words[0] in ("check", "latency", "calibrate", "stop", "scan", "doctor")
    return any(word.startswith(("ble", "usb")) for word in words) or (
        asks_for_it and "virtual" not in words
    )
