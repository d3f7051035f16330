"""``bricksrl camera``: color calibration of a camera."""

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.terminal import print_line
from brickhub.fields import Count
from brickhub.options import Existing, Flag, option, refuse_ignored
from brickhub.user_files import check_there
from bricksrl.envs.registry import get_task
from bricksrl.envs.vision.camera import TwinCamera, VideoCamera
from bricksrl.envs.vision.color_calibration import (
    FoundRed,
    calibrate_red,
    picture,
    saved_path,
    spanning,
    write_red,
)
from bricksrl.envs.vision.frames import find_red
from bricksrl.errors import CameraError
from bricksrl.plotting import save_image
from bricktwin.twin.make_body import make_body


@dataclass(frozen=True)
class CalibrateCamera:
    """Calibrate the colors of the red ball for this camera and light.

    Put the ball into the picture. Without --at, the largest region of strong red is taken for the
    ball. The PNG shows the result: the ball outlined, and beside it every pixel that counts as red.
    A real robot uses the saved calibration of its camera; to use another file, or with a virtual
    robot, train with `--option calibration=FILE`.

    Examples:
      bricksrl camera calibrate
      bricksrl camera calibrate --camera 1 --at 320 400
      bricksrl camera calibrate --twin --out red.json
    """

    env: Annotated[Positional[str], option(metavar="ENV"), Existing(check_there)] = (
        "RoboArm_mixed-v0"
    )
    """Environment with the camera."""
    camera: Annotated[str, option(metavar="N")] = "0"
    """Camera of the robot: its OpenCV number, or the address of a stream."""
    twin: Flag = False
    """Take the frames from a virtual robot."""
    at: Annotated[tuple[int, int] | None, option(metavar="X Y")] = None
    """A point of the ball, in px from the upper left corner."""
    frames: Annotated[Count, option(metavar="N")] = 5
    """Frames to take; the first half is discarded, while the camera adapts to the light."""
    out: Annotated[Path | None, option(metavar="FILE")] = None
    """File to write; by default the camera's file in your settings folder, which environments
    read."""

    def execute(self) -> None:
        if self.twin and self.out is None:
            raise CameraError(
                "a virtual robot finds no calibration by itself; name a file with --out"
            )
        if self.twin:
            refuse_ignored(self, ("--env", "--twin", "--at", "--frames", "--out"), "with --twin")
        if self.out is not None and self.out.suffix.lower() == ".png":
            raise CameraError(
                f"'{self.out}' is the name of the picture that is written too; end it in .json"
            )
        task = get_task(self.env)
        if task.camera is None:
            raise CameraError(f"{self.env} has no camera; choose an environment that has one")
        device = int(self.camera) if self.camera.isdecimal() else self.camera
        view = replace(task.camera, device=device)
        opened: TwinCamera | VideoCamera
        if self.twin:
            opened = TwinCamera(make_body(task.robot, scene=task.scene), view)
        else:
            opened = VideoCamera(view)
        with closing(opened) as camera:
            frames = [camera.frame() for _ in range(self.frames)]
        # The first half shows the camera adapting its exposure and its white balance.
        settled = frames[len(frames) // 2 :]
        calibrations = [calibrate_red(frame, self.at) for frame in settled]
        # What was red in any of them, as light flickers.
        window = spanning([calibration.window for calibration in calibrations])
        ball = FoundRed(window, calibrations[-1].mask)
        path = self.out or saved_path(device)
        write_red(path, ball.window)
        save_image(path.with_suffix(".png"), picture(frames[-1], ball))
        x, y = ball.middle
        red_objects = len(find_red(frames[-1], ball.window))
        print_line(f"ball     at {x}, {y} (an area of {int(ball.mask.sum())} px)")
        print_line(f"hue      {window.hue_deg[0]:g} to {window.hue_deg[1]:g} degrees")
        print_line(f"from     saturation {window.saturation:.2f}, value {window.value:.2f}")
        if red_objects > 1:
            print_line(
                f"beware   {red_objects} red objects are in the picture; remove the others, or "
                "name a point with --at"
            )
        print_line(f"saved    {path}")
        print_line(f"picture  {path.with_suffix('.png')}")
