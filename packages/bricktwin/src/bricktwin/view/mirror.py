"""Mirror of a robot: a model for drawing only, whose joints are set, not simulated."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import Goal
from bricktwin.twin.sensed_pose import pose_at
from bricktwin.view.body_drawing import drawing_of
from bricktwin.view.drawing_of_body import HIDDEN, DrawnBody, Floats, View, poses

_GHOST = (0.10, 0.62, 0.25, 0.45)


class Mirror:
    """Mirror of a robot with a MuJoCo model. The last bodies of its drawing are those of a ghost of
    the robot, at its goal.

    Args:
        body: the model, for this alone.
        view: the first view; by default that of the robot.

    Attributes:
        drawing: its drawing, with the ghost.
        numbers: the model's number of each drawn body, without the ghost.
    """

    def __init__(
        self,
        body: MujocoBody,
        view: View | None = None,
    ) -> None:
        self.body = body
        drawing = drawing_of(self.body)
        model = self.body.model
        roots = model.body_rootid
        welds = model.body_weldid
        root = roots[self.body.chassis]
        self.numbers: list[int] = []
        self._ghost_numbers: list[int] = []
        ghosts = []
        for drawn in drawing.bodies:
            number = drawn.model_body
            if number is None:
                continue
            self.numbers.append(number)
            # What is welded to the world, such as a table, stands in no other place.
            is_moving = welds[number] != 0
            if is_moving and roots[number] == root:
                faded = tuple(replace(shape, colour=_GHOST) for shape in drawn.shapes)
                ghosts.append(DrawnBody(f"goal {drawn.name}", faded))
                self._ghost_numbers.append(number)
        self.drawing = replace(
            drawing,
            bodies=(*drawing.bodies, *ghosts),
            view=view or drawing.view,
        )
        self._ghost: MujocoBody | None = None
        self._goal: Goal | None = None
        nowhere = [(HIDDEN, 0.0, 0.0)] * len(ghosts)
        self._hidden = poses(nowhere)
        self._ghost_poses = self._hidden

    def poses(
        self,
        qpos: NDArray[np.float64],
        goal: Goal | None = None,
        moved_m: NDArray[np.float64] | None = None,
    ) -> Floats:
        """Poses ``[bodies, 7]`` of the drawn bodies at these joint positions, and places ``[n, 3]``
        of what a hand moves; without a goal the ghost is hidden."""
        data = self.body.data
        data.qpos[:] = qpos
        if moved_m is not None:
            data.mocap_pos[:] = moved_m
        self.body.update_visuals()
        shown = poses(data.xpos[self.numbers], data.xquat[self.numbers])
        ghost = self._poses_at(goal)
        return np.concatenate([shown, ghost])

    def _poses_at(self, goal: Goal | None) -> Floats:
        if goal is None:
            return self._hidden
        # A pose is searched for, which takes a while: once for each goal.
        if goal != self._goal:
            self._goal = goal
            if self._ghost is None:
                self._ghost = MujocoBody(
                    self.body.robot,
                    self.body.scene,
                    Physics(),
                    0,
                )
            pose_at(self._ghost, goal)
            data = self._ghost.data
            self._ghost_poses = poses(
                data.xpos[self._ghost_numbers], data.xquat[self._ghost_numbers]
            )
        return self._ghost_poses
