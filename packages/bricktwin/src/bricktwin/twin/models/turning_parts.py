"""Parts of a model that turn visually only: rods between two pins, shafts and gears. Physics does
without them; they are turned before a robot is drawn."""

from typing import NamedTuple

from bricktwin.twin.engines.conventions import ROD, SPINNER, SPINNER_USER, motor_name
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import (
    Vector,
    about,
    from_vertical,
    minus,
    rotated_back,
    vector,
)


class TurningShaft(NamedTuple):
    """Shaft or gear by the numbers of its model: its body, the address of the joint's position that
    turns it, ratio and axis [3]."""

    body: int
    address: int
    ratio: float
    axis: Vector


class TurningRod(NamedTuple):
    """Rod by the numbers of its model: its body, and the site of its far pin."""

    body: int
    far_site: int


class TurningParts:
    """Parts of a model that turn visually only: ``spinners`` and ``rods``."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._quaternions = engine.parameters("body_quat")
        self._parents = engine.indices("body_parentid")
        self.spinners: list[TurningShaft] = []
        self.rods: list[TurningRod] = []
        addresses = engine.indices("jnt_qposadr")
        bodies = engine.names("body")
        user_data = engine.nominal("body_user")
        user_numbers = len(user_data) // len(bodies)
        for body, full_name in enumerate(bodies):
            # In an arena all names of a robot begin with "ROBOT/".
            robot, slash, name = full_name.rpartition("/")
            # A user's model may have bodies of such names, too, but not with what belongs to them.
            if name.startswith(SPINNER) and user_numbers >= SPINNER_USER:
                port = name.split("_")[1]
                joint = engine.index("joint", f"{robot}{slash}{motor_name(port)}")
                if joint >= 0:
                    first = user_numbers * body
                    ratio, *axis = user_data[first : first + SPINNER_USER]
                    shaft = TurningShaft(body, addresses[joint], ratio, vector(axis))
                    self.spinners.append(shaft)
            elif name.startswith(ROD):
                far = engine.index("site", f"{full_name}_far")
                if far >= 0:
                    self.rods.append(TurningRod(body, far))
        self._starts = engine.nominal("qpos0")

    def turn(self) -> None:
        """Turn shafts and gears with their motors' joints, rods to their far pins; positions must
        be up to date, and are so afterwards."""
        if not (self.spinners or self.rods):
            return
        engine = self._engine
        quaternions = self._quaternions
        for body, address, ratio, axis in self.spinners:
            turned = engine.qpos[address] - self._starts[address]
            quaternions[4 * body : 4 * body + 4] = about(axis, ratio * turned)
        places = engine.derived("xpos")
        orientations = engine.derived("xquat")
        pins = engine.derived("site_xpos")
        for body, far in self.rods:
            far_m = vector(pins[3 * far : 3 * far + 3])
            near_m = vector(places[3 * body : 3 * body + 3])
            parent = 4 * self._parents[body]
            along_m = rotated_back(minus(far_m, near_m), orientations[parent : parent + 4])
            quaternions[4 * body : 4 * body + 4] = from_vertical(along_m)
        # The turns were written into the model; the places follow from it.
        engine.set_parameters("body_quat", quaternions)
        engine.kinematics()
