"""``bricksrl new``: templates of a task, a robot and an algorithm."""

import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Positional

from brickhub.cli.terminal import print_line
from brickhub.files import quoted, refuse_existing, write_durably
from brickhub.options import option
from bricksrl.errors import DescriptionError


def write_template(kind: str, path: Path | str) -> None:
    """Write the template of a task, a robot or an agent to a new Python file, with the file's name
    filled in. Raises DescriptionError if the name is not that of a Python module, or the file
    exists."""
    path = Path(path)
    if path.suffix != ".py" or not path.stem.isidentifier():
        raise DescriptionError(
            f"'{path.name}' is not a name of a Python file; give letters, digits and underscores, "
            f"as in my_{kind}.py"
        )
    refuse_existing(path, DescriptionError)
    template = resources.files("bricksrl.cli.templates") / f"{kind}.py"
    text = template.read_text(encoding="utf-8")
    # my_fast_walker.py has the task MyFastWalker-v0; a name without Latin letters has My-v0.
    words = re.findall(r"[a-zA-Z0-9]+", path.stem)
    name = "".join(word.title() for word in words) or "My"
    text = text.replace("my_file.py", path.name).replace("MyTask-v0", f"{name}-v0")
    write_durably(path, text.encode())


@dataclass(frozen=True)
class _New:
    """Command that writes the template of a ``kind``; ``train`` is the command to train with a
    file."""

    kind: ClassVar[str]
    train: ClassVar[str] = "bricksrl train {} --episodes 30"

    file: Annotated[Positional[Path], option(metavar="FILE")]
    """The Python file to write, which must not exist."""

    def execute(self) -> None:
        write_template(self.kind, self.file)
        print_line(f"{self.kind:8}{self.file}")
        print_line(f"check   bricksrl check {quoted(self.file)}")
        print_line(f"train   {self.train.format(quoted(self.file))}")


@dataclass(frozen=True)
class NewTask(_New):
    """Write a commented template of a task, which can be trained as it is.

    Examples:
      bricksrl new task my_task.py
    """

    kind = "task"


@dataclass(frozen=True)
class NewRobot(_New):
    """Write a commented template of a robot with a first task, which can be trained as it is.

    Examples:
      bricksrl new robot my_robot.py
    """

    kind = "robot"


@dataclass(frozen=True)
class NewAgent(_New):
    """Write a commented template of an algorithm, which learns as it is.

    Examples:
      bricksrl new agent my_agent.py
    """

    kind = "agent"
    train = "bricksrl train WalkerSim-v0 --agent {} --episodes 20"
