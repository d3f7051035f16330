"""Parts of linkages: couplings, loops, and what turns visually only, rods between two pins, shafts
and gears.

A rod is modelled as a constant distance between its pins. This takes a fraction of the time of a
body with two joints, one of which closes a loop. It is drawn as a massless body, fixed to one pin
and turned towards the other before rendering.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from bricktwin.plans.geometry import Floats, Triple
from bricktwin.plans.mechanism.articulation import Follower, Geared
from bricktwin.twin.models.mjcf import SHAPE_GROUP

_SPINNER = "spin_"
"""First letters of the names of shafts and gears: `TurningParts` finds them by these, as a compiled
model keeps nothing else of what they are."""
_SPINNER_USER = 4
"""Numbers of a shaft's or gear's user data: ratio and axis [3]."""
_ROD = "rod_"
"""First letters of the names of rods."""


def add_rod(
    spec: mujoco.MjSpec,
    name: str,
    near: tuple[mujoco.MjsBody, Triple],
    far: tuple[mujoco.MjsBody, Triple],
) -> mujoco.MjsBody:
    """Join two bodies, each given with its pin's position, by a rod of the pins' distance in the
    initial configuration.

    It has no mass: the bodies carry half of it each. Several rods may have one name, which gets a
    number.

    Returns:
        The body to draw the rod on: its origin is the near pin, its z axis points to the far one.
    """
    if spec.tendon(_ROD + name) is not None:
        name = f"{name}_{len(spec.tendons)}"
    name = _ROD + name
    # A tendon between the pins measures their distance, and an equality keeps it.
    tendon = spec.add_tendon(name=name, group=SHAPE_GROUP)
    for end, (carrier, pin) in {"near": near, "far": far}.items():
        site = carrier.add_site(
            name=f"{name}_{end}",
            pos=list(pin),
            group=SHAPE_GROUP,
        )
        tendon.wrap_site(site.name)
    constraint = spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
    )
    constraint.name1 = name
    # A polynomial of zeros: the length is that of the initial configuration.
    constraint.data[:5] = 0.0
    # Stiff: with MuJoCo's default the ends of a light rod separate by fractions of a millimetre.
    constraint.solref = [2 * spec.option.timestep, 1.0]
    constraint.solimp = [0.99, 0.99, 0.001, 0.5, 2.0]
    near_body, near_pin = near
    body: mujoco.MjsBody = near_body.add_body(name=name, pos=list(near_pin))
    return body


def add_spinner(
    body: mujoco.MjsBody,
    number: int,
    follower: Follower,
    at_m: Triple,
) -> mujoco.MjsBody:
    """Add a body that turns with a motor, to draw on."""
    # What turns it is the port in its name, and by how much its user data: both survive in a kept
    # model, from which `TurningParts` reads them.
    axis = -follower.axis
    ratio_and_axis = [follower.ratio, *axis.tolist()]
    return body.add_body(
        name=f"{_SPINNER}{follower.port}_{number}",
        pos=at_m,
        userdata=ratio_and_axis,
    )


def add_coupling(
    spec: mujoco.MjSpec,
    geared: Geared,
    name: str,
    joint: str,
) -> None:
    """Couple a joint to that of the motor that it is geared to."""
    constraint = spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
    )
    constraint.name1 = joint
    constraint.name2 = f"motor_{geared.port}"
    # Coefficients of a polynomial in the motor's angle: a ratio is its linear term.
    constraint.data[:5] = [0.0, geared.ratio, 0.0, 0.0, 0.0]


def add_loop(
    spec: mujoco.MjSpec,
    name: str,
    body: mujoco.MjsBody,
    other: mujoco.MjsBody,
    at_m: Triple,
) -> None:
    """Connect two bodies at a pin, given in the first one's frame, that is no joint of the tree."""
    constraint = spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
    )
    constraint.name1 = body.name
    constraint.name2 = other.name
    constraint.data[:3] = at_m
    # MuJoCo allows no stiffer constraint than one with a time constant of two steps.
    constraint.solref = [2 * spec.option.timestep, 1.0]


@dataclass(frozen=True)
class TurningShaft:
    """Shaft or gear by the numbers of its model: its body, the address of the joint's position that
    turns it, ratio and axis [3]."""

    body: int
    address: int
    ratio: float
    axis: Floats


@dataclass(frozen=True)
class TurningRod:
    """Rod by the numbers of its model: its body, and the site of its far pin."""

    body: int
    far_site: int


class TurningParts:
    """Parts of a model that turn visually only: ``spinners`` and ``rods``."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.spinners: list[TurningShaft] = []
        self.rods: list[TurningRod] = []
        for body in range(model.nbody):
            full_name = model.body(body).name
            # In an arena all names of a robot begin with "ROBOT/".
            robot, slash, name = full_name.rpartition("/")
            # A user's model may have bodies of such names, too, but not with what belongs to them.
            if name.startswith(_SPINNER) and model.nuser_body >= _SPINNER_USER:
                port = name.split("_")[1]
                motor = f"{robot}{slash}motor_{port}"
                joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, motor)
                if joint >= 0:
                    ratio, *axis = model.body_user[body, :_SPINNER_USER].tolist()
                    address = int(model.jnt_qposadr[joint])
                    shaft = TurningShaft(
                        body,
                        address,
                        ratio,
                        np.array(axis),
                    )
                    self.spinners.append(shaft)
            elif name.startswith(_ROD):
                far = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{full_name}_far")
                if far >= 0:
                    self.rods.append(TurningRod(body, far))

    def turn(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
    ) -> None:
        """Turn shafts and gears with their motors' joints, rods to their far pins; positions must
        be up to date, and are so afterwards."""
        for shaft in self.spinners:
            turned = float(data.qpos[shaft.address] - model.qpos0[shaft.address])
            angle = shaft.ratio * turned
            mujoco.mju_axisAngle2Quat(model.body_quat[shaft.body], shaft.axis, angle)
        for rod in self.rods:
            parent = model.body_parentid[rod.body]
            frame = data.xmat[parent].reshape(3, 3)
            along_m = data.site_xpos[rod.far_site] - data.xpos[rod.body]
            mujoco.mju_quatZ2Vec(model.body_quat[rod.body], along_m @ frame)
        # The turns were written into the model; the positions in the data follow from it.
        if self.spinners or self.rods:
            mujoco.mj_kinematics(model, data)
