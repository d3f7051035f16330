"""Sphinx: pages of `docs`, reference from docstrings, environments from their tasks, the command
line from its own help."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
sys.path[:0] = [
    str(DOCS.parent / "packages" / house / "src") for house in ("brickhub", "bricktwin", "bricksrl")
]
sys.path.append(str(DOCS.parent))

import bricksrl
from brickhub.cli.app import CommandLine

project = "BricksRL"
author = "The BricksRL developers"
release = bricksrl.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "episodes", "hub_programs"]
suppress_warnings = ["ref.python"]  # some names, such as `make`, are in two modules
html_theme = "furo"
html_title = "BricksRL"
html_extra_path = ["llms.txt"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # the tests execute the notebooks
autodoc_typehints = "description"
autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
napoleon_use_ivar = True

SOURCE = (
    tomllib.loads(Path("../pyproject.toml").read_text(encoding="utf-8"))["tool"]["bricksrl"][
        "address"
    ]
    + "/blob/main"
)
linkcheck_ignore = [f"{SOURCE}.*"]


def outside(_app: object, _name: str, source: list[str]) -> None:
    """Links to files outside of `docs` lead to the repository."""
    source[0] = re.sub(r"\]\(\.\./(?!\w+\.(?:md|ipynb))([^)]+)\)", rf"]({SOURCE}/\1)", source[0])
    source[0] = re.sub(
        r"\]\(\.\./(README|CONTRIBUTING|CHANGELOG|SECURITY)\.md\)", rf"]({SOURCE}/\1.md)", source[0]
    )


TURNED = """```{{raw}} html
<iframe src="../episodes/{0}.html" title="{0}, to turn" loading="lazy" style="width: 100%; height: 400px; border: 0"></iframe>
```

"""  # noqa: E501
"""An episode in 3D, on a page of its own."""


ALIVE = """<p><a href="../tab/index.html#example={0}"><b>▶ Alive in a tab</b></a>: its trained policy, as its hub's program.</p>

"""  # noqa: E501
"""A robot that acts by its policy, in the site that `make docs` puts beside these pages."""


def write(path: Path, text: str) -> None:
    """A generated page, written when it changed."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def environments() -> str:
    """A section for each environment: its task's own description."""
    from bricksrl.envs import get_task, list_envs
    from bricksrl.envs.registry import simulation_text

    parts = [
        "# Environments\n",
        "Each description comes from its task. `bricksrl list --json` prints them for programs.\n",
    ]
    for env_id, summary in list_envs().items():
        picture = f"images/{env_id.lower().replace('-', '_')}.gif"
        # a simulation has no robot
        shown = f"![An episode of {env_id}](../{picture})\n\n" if (DOCS / picture).exists() else ""
        if (DOCS / "episodes" / f"{env_id}.json").exists():
            shown += TURNED.format(env_id)
        program = f"{env_id.lower().replace('-', '_')}.py"
        if (DOCS / "hub_programs" / program).exists():
            shown += ALIVE.format(program)
        body = re.sub(
            r"^## ", "### ", get_task(env_id).doc.partition("\n")[2].strip(), flags=re.MULTILINE
        )
        if simulated := simulation_text(env_id):
            body = f"{simulated}\n\n{body[body.index('### ') :]}"  # in place of what a hub does
        parts.append(f"## {env_id}\n\n{summary}\n\n{shown}{body}\n")
    return "\n".join(parts)


def commands() -> str:
    """The help of each command, as it prints it."""
    import brickhub.cli.command_table
    import bricksrl.cli.app
    import bricktwin.cli.command_table

    os.environ["COLUMNS"] = "100"
    parts = [
        "# Command line\n",
        (
            "All commands, with the help that `bricksrl COMMAND --help` prints. The last "
            "sections are for"
        ),
    ]
    parts += [
        (
            "those who have `brickhub` or `bricktwin` alone; the same commands are `bricksrl hub`, "
            "`plan` and `twin`.\n"
        )
    ]
    for line in (
        bricksrl.cli.app.LINE,
        brickhub.cli.command_table.LINE,
        bricktwin.cli.command_table.LINE,
    ):
        names = [[name] for name in line.commands]
        names += [[group, name] for group, (_, below) in line.groups.items() for name in below]
        parts += [
            f"## {line.prog} {' '.join(name)}\n\n```text\n{help_of(line, name)}\n```\n"
            for name in sorted(names)
        ]
    return "\n".join(parts)


def help_of(line: CommandLine, words: list[str]) -> str:
    """The help of one command, without colours."""
    from brickhub.cli.app import parse

    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        parse(line, [*words, "--help"])
    return re.sub(r"\x1b\[[0-9;]*m", "", text.getvalue()).rstrip()


def generate(app: Any) -> None:
    """Pages that follow from the package."""
    from benchmarks.episodes import page_of

    episodes = Path(app.outdir) / "episodes"
    episodes.mkdir(parents=True, exist_ok=True)
    for path in (DOCS / "episodes").glob("*.json"):
        write(episodes / f"{path.stem}.html", page_of(path))
    write(DOCS / "reference/environments.md", environments())
    write(DOCS / "reference/cli.md", commands())


def setup(app: object) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", generate)  # type: ignore[attr-defined]
    app.connect("source-read", outside)  # type: ignore[attr-defined]
