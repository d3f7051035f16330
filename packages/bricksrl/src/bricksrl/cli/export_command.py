"""``bricksrl export``: a trained policy as a file for other programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from brickhub.cli.options import Flag, option
from brickhub.cli.terminal import print_line
from bricksrl.cli.terminal import load_learning


@dataclass(frozen=True)
class Export:
    """Export a trained policy to a file that can be used without BricksRL.

    The file is read back and compared with the policy. Its model maps observations [batch, n] in the units of the environment,
    and images [batch, side, side, 3] where the policy uses them, to actions [batch, m] in -1..1.

    Examples:
      bricksrl export runs/spin --out spin.pt2
      bricksrl export runs/spin --format onnx --out spin.onnx
    """

    run: Annotated[Positional[Path], option(metavar="RUN")]
    """Folder of a run, or of a shared policy."""
    out: Annotated[Path, option(metavar="FILE")]
    """File to write, which must not exist."""
    format: Annotated[Literal["torch-export", "onnx"], option(metavar="NAME")] = "torch-export"
    """torch-export, for torch.export.load; or onnx, which needs the packages onnx and onnxscript."""
    best: Flag = False
    """Use the checkpoint of the best evaluation during training instead of the last one."""

    def execute(self) -> None:
        load_learning()
        from bricksrl.policies.export import export_model

        difference = export_model(self.run, self.out, self.format, which="best" if self.best else "last")
        print_line(f"written  {self.out}  (its actions differ by {difference:.2g} at most from the policy's)")
