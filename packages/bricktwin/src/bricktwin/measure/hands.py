"""Hands: a person who puts, turns, lifts and holds a robot when told to, and a simulated one for a
virtual robot."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from brickhub.errors import TwinError
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.standing import Pose

_TURN_DEG_S = 120.0
_LIFT_M = 0.3
_GRIP_NM_S = 1e3
"""Damping of a chassis in the hand, which no motor moves."""
_GRIP_NM = 10.0
"""Friction of a shaft in the hand, which its motor does not turn."""


@dataclass(frozen=True)
class Deed:
    """A deed that the person is asked for, after which the robot stands on the floor or is in the
    hand.

    Attributes:
        text: words for the person.
        turn_deg: turn on the spot, clockwise seen from above.
        is_lifted: whether nothing touches its wheels or legs afterwards.
        holds: name of the motor whose shaft is held, too.
        wall_mm, wall_deg: distance of the ultrasonic sensor to a wall, and angle to the wall's
            normal.
    """

    text: str
    turn_deg: float = 0.0
    is_lifted: bool = False
    holds: str = ""
    wall_mm: float | None = None
    wall_deg: float = 0.0


class Person(Protocol):
    """A person who carries out deeds: a real one, or a simulated one."""

    def begin(self, deed: Deed) -> None:
        """Ask for a deed."""

    def is_done(self) -> bool:
        """Whether the last deed is done. The robot is read meanwhile, so this must not wait."""


class SimulatedPerson:
    """A person who moves a virtual robot, in its time. Raises TwinError if the robot cannot be
    taken in hand.

    Args:
        rng: of the errors.
        error_deg, error_s: largest error of an angle, and of the time of an answer.
    """

    def __init__(
        self,
        hub: VirtualHub,
        rng: np.random.Generator,
        error_deg: float = 1.0,
        error_s: float = 1.0,
    ) -> None:
        if not isinstance(hub.body, MujocoBody) or not hub.body.moves:
            raise TwinError(
                f"the virtual '{hub.robot.name}' cannot be taken in hand; choose a robot that "
                "moves, or --hub ble"
            )
        self._hub = hub
        self._body = hub.body
        self._rng = rng
        self._error_deg = error_deg
        self._error_s = error_s
        # A hand changes these values of the model, so their nominal values are kept.
        model = self._body.model
        held = (model.dof_damping, model.dof_frictionloss, model.opt.gravity)
        self._nominal = [(array, array.copy()) for array in held]
        heading_deg = self._body.pose().heading_deg
        self._edge_deg = heading_deg
        self._at_deg = heading_deg
        self._aim_deg = heading_deg
        self._now_s = hub.now_s()
        self._done_s = self._now_s

    def begin(self, deed: Deed) -> None:
        body = self._body
        # The hand of the deed before lets go.
        for array, nominal in self._nominal:
            array[:] = nominal
        # The edge along which the robot lies stays where it is, so that errors do not add up.
        if deed.wall_mm is None:
            self._edge_deg += deed.turn_deg
        else:
            self._edge_deg = deed.wall_deg
        error_deg = self._rng.uniform(-self._error_deg, self._error_deg)
        self._aim_deg = self._edge_deg + error_deg
        self._now_s = self._hub.now_s()
        turning_s = abs(deed.turn_deg) / _TURN_DEG_S
        hesitating_s = self._rng.uniform(0.0, self._error_s)
        self._done_s = self._now_s + turning_s + hesitating_s
        body.data.qvel[:] = 0.0
        if deed.is_lifted:
            self._lift(deed.holds)
        elif deed.wall_mm is not None:
            self._at_deg = self._aim_deg
            body.face_wall(deed.wall_mm, self._at_deg)
        else:
            self._put()
        body.update_turns()

    def is_done(self) -> bool:
        now_s = self._hub.now_s()
        if self._at_deg != self._aim_deg:
            # A hand turns the robot only so far in the time since the last look.
            most_deg = _TURN_DEG_S * (now_s - self._now_s)
            missing_deg = self._aim_deg - self._at_deg
            self._at_deg += min(max(missing_deg, -most_deg), most_deg)
            self._put()
        self._now_s = now_s
        return now_s >= self._done_s and self._at_deg == self._aim_deg

    def _lift(self, motor: str) -> None:
        """Lift the robot, and hold the shaft of a motor, unless its name is empty."""
        body = self._body
        model = body.model
        first_dof = int(model.body_dofadr[body.chassis])
        model.dof_damping[first_dof : first_dof + 6] = _GRIP_NM_S
        model.opt.gravity[:] = 0.0
        body.data.qpos[body.base_address + 2] = _LIFT_M
        if motor:
            actuator = body.actuator(body.robot.motor(motor).port)
            joint = model.actuator_trnid[actuator, 0]
            model.dof_frictionloss[model.jnt_dofadr[joint]] = _GRIP_NM
        # A lifted robot keeps its heading, so no error of an angle is added.
        self._aim_deg = self._at_deg

    def _put(self) -> None:
        """Put the robot down where it is, with its present heading."""
        place = self._body.pose()
        self._body.put(Pose(place.x_m, place.y_m, self._at_deg))
        self._body.update_turns()
