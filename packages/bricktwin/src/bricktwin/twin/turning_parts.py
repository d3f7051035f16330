"""Parts of a model that turn visually only: rods between two pins, shafts and gears. Physics does
without them; they are turned before a robot is drawn."""

from bricktwin.twin.conventions import ROD, SPINNER, SPINNER_USER, motor_name
from bricktwin.twin.engine import Engine
from bricktwin.twin.rotations import Vector, about, from_vertical, minus, rotated_back, vector


class TurningParts:
    """Parts of a model that turn visually only."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._quaternions = engine.parameters("body_quat")
        self._parents = engine.indices("body_parentid")
        self._spinners: list[tuple[int, int, float, Vector]] = []
        """Body, address of the joint's position, ratio and axis [3] of each shaft or gear."""
        self._rods: list[tuple[int, int]] = []
        """Body, and site of the far pin of each rod."""
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
                    self._spinners.append((body, addresses[joint], ratio, vector(axis)))
            elif name.startswith(ROD):
                far = engine.index("site", f"{full_name}_far")
                if far >= 0:
                    self._rods.append((body, far))
        self._starts = engine.nominal("qpos0")

    def turn(self) -> None:
        """Turn shafts and gears with their motors' joints, rods to their far pins; positions must
        be up to date, and are so afterwards."""
        if not (self._spinners or self._rods):
            return
        engine = self._engine
        quaternions = self._quaternions
        for body, address, ratio, axis in self._spinners:
            turned = engine.qpos[address] - self._starts[address]
            quaternions[4 * body : 4 * body + 4] = about(axis, ratio * turned)
        places = engine.derived("xpos")
        orientations = engine.derived("xquat")
        pins = engine.derived("site_xpos")
        for body, far in self._rods:
            far_m = vector(pins[3 * far : 3 * far + 3])
            near_m = vector(places[3 * body : 3 * body + 3])
            parent = 4 * self._parents[body]
            along_m = rotated_back(minus(far_m, near_m), orientations[parent : parent + 4])
            quaternions[4 * body : 4 * body + 4] = from_vertical(along_m)
        # The turns were written into the model; the places follow from it.
        engine.set_parameters("body_quat", quaternions)
        engine.kinematics()
