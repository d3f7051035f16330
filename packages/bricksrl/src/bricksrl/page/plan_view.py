"""Building plan in the browser, with sliders for its step and for each motor and free joint."""

import math
import threading
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from bricksrl.errors import PlanError
from bricksrl.page.board import Board
from bricksrl.page.server import PageOptions, PageServer, is_finite
from bricksrl.page.visitors import Visitor
from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing.looks import TINTS, Tint
from bricktwin.plans.drawing.meshes import surface_of
from bricktwin.plans.drawing.shapes import shape_of
from bricktwin.plans.geometry import M_PER_LDU
from bricktwin.plans.mechanism.kinematics import TO_TWIN
from bricktwin.plans.part import Part
from bricktwin.plans.plan import Plan
from bricktwin.plans.planned_robot import PlannedRobot, planned
from bricktwin.twin.models.linkage import Linkage
from bricktwin.view.drawing_of_body import (
    HIDDEN,
    Drawing,
    DrawnBody,
    Floats,
    Mesh,
    Shape,
    View,
    mesh_of,
    poses,
)

_MAX_DEG = 360


class PlanView(PageServer):
    """Page of a plan, served while entered.

    Args:
        plan: plan to show; one that is not a complete robot has steps but no joints.
        options: address of the server.
    """

    def __init__(
        self,
        plan: Plan,
        options: PageOptions | None = None,
    ) -> None:
        super().__init__(
            Board(),
            self.press,
            lambda: None,
            options,
        )
        if not plan.parts:
            raise PlanError(
                f"{plan.path} has no part that the catalogue knows; run `bricksrl plan check` on it"
            )
        self._plan = plan
        self._lock = threading.Lock()
        self._steps = list(plan.different_steps)
        self._robot: PlannedRobot | None = None
        self._linkage: Linkage | None = None
        self._sliders: dict[str, str] = {}
        message = ""
        # A plan in the making has no joints yet, and is looked at all the same.
        try:
            self._robot = planned(plan)
            self._linkage = Linkage(self._robot.articulation)
            self._sliders = _sliders(self._robot, self._linkage)
        except PlanError as error:
            message = f"{error}. The joints are not shown."
        self._step = len(self._steps)
        self._angles = dict[str, float]()
        self.board.show_drawing(_drawing(plan), self._poses())
        self.board.update_status(
            title=plan.title,
            subtitle="building plan",
            state="",
            controls=["step", "reset"],
            message=message,
        )
        self._publish()

    def press(
        self,
        name: str,
        value: Any,
        _visitor: Visitor | None = None,
    ) -> None:
        """Handle a press on the page; unknown ones are ignored."""
        with self._lock:
            match name, value:
                case "step", _:
                    self._step = self._step % len(self._steps) + 1
                case "reset", _:
                    self._angles = {}
                    self._step = len(self._steps)
                    # A linkage remembers how it was turned; a new one stands as it was built.
                    if self._robot is not None:
                        self._linkage = Linkage(self._robot.articulation)
                case "slider", ["Step", number] if is_finite(number):
                    self._step = min(max(round(number), 1), len(self._steps))
                case "slider", [str(label), number] if is_finite(number) and label in self._sliders:
                    angle_deg = min(max(float(number), -_MAX_DEG), _MAX_DEG)
                    self._angles[self._sliders[label]] = math.radians(angle_deg)
                case _:
                    return
            self.board.show_poses(self._poses())
            self._publish()

    def _publish(self) -> None:
        step = self._steps[self._step - 1]
        sliders: list[dict[str, Any]] = [
            {
                "name": "Step",
                "low": 1,
                "high": len(self._steps),
                "value": self._step,
                "text": f"{self._step}",
            }
        ]
        for label, joint in self._sliders.items():
            angle_deg = round(math.degrees(self._angles.get(joint, 0.0)))
            sliders.append({"name": label, "low": -_MAX_DEG, "high": _MAX_DEG, "value": angle_deg})
        assembly = step.assembly[-1].rpartition(":")[0] if step.assembly else ""
        facts = {
            "step": f"{self._step} of {len(self._steps)}",
            "parts": len(self._plan.present_parts(step)),
        }
        if assembly:
            facts["builds"] = assembly
        self.board.update_status(
            sliders=sliders,
            facts=facts,
            note=step.note,
        )

    def _poses(self) -> Floats:
        """Poses of the parts [parts, 7]."""
        if self._linkage is not None:
            self._linkage.turn(self._angles)
        visible = self._plan.present_parts(self._steps[self._step - 1])
        positions = []
        turns = np.empty((len(self._plan.parts), 4))
        for quaternion, placed in zip(turns, self._plan.parts, strict=True):
            turn = np.eye(3)
            shift_m = np.zeros(3)
            if self._linkage is not None:
                turn, shift_m = self._linkage.motion(placed.index)
            # From LDraw's axes to the twin's, then as its body has moved.
            axes = turn @ TO_TWIN
            mujoco.mju_mat2Quat(quaternion, (axes @ placed.rotation).ravel())
            position_m = axes @ placed.position * M_PER_LDU + shift_m
            if placed.index not in visible:
                position_m = np.array([HIDDEN, 0.0, 0.0])
            positions.append(position_m)
        return poses(np.array(positions), turns)


def _sliders(robot: PlannedRobot, linkage: Linkage) -> dict[str, str]:
    """Sliders by name, each with the joint that it turns."""
    sliders: dict[str, str] = {}
    for drive in robot.articulation.drives:
        placed = robot.device(drive.port)
        name = placed.device if placed is not None and placed.device else "motor"
        sliders[f"{name}, port {drive.port}, deg"] = f"motor_{drive.port}"
    for number, joint in enumerate(linkage.free, 1):
        sliders[f"joint {number}, deg"] = joint
    return sliders


def _drawing(plan: Plan) -> Drawing:
    """Drawing with a body for each part, with the part's origin."""
    pieces: dict[Part, dict[Tint, Mesh]] = {}
    bodies = []
    corners = []
    for placed in plan.parts:
        part = placed.part
        if part not in pieces:
            # Once for each kind of part: a plan has hundreds of a few kinds.
            surface = surface_of(part)
            pieces[part] = {}
            for tint in Tint:
                shape = shape_of(surface.triangles[surface.tints == int(tint)])
                if shape is not None:
                    pieces[part][tint] = mesh_of(shape, M_PER_LDU)
        main = colour_of(placed.colour).rgb
        shapes = []
        for tint, mesh in pieces[part].items():
            # A tint is a colour of its own, such as of a motor's shaft, or else the part's.
            shapes.append(Shape(mesh, (*TINTS.get(tint, main), 1.0)))
        bodies.append(DrawnBody(f"{placed.index}", tuple(shapes)))
        for corner in part.bounds:
            (placed_corner,) = placed.to_plan(np.array([corner]))
            corners.append(TO_TWIN @ placed_corner)
    points = np.array(corners) * M_PER_LDU
    lowest = points.min(axis=0)
    highest = points.max(axis=0)
    x, y, z = ((lowest + highest) / 2).tolist()
    size = float(np.linalg.norm(highest - lowest))
    view = replace(
        View(),
        target=(x, y, z),
        distance_m=1.8 * size,
        yaw_deg=35.0,
    )
    return Drawing(tuple(bodies), floor_m=float(lowest[2]), view=view)
