"""Parts of linkages: couplings, loops, and what turns visually only, rods between two pins, shafts
and gears.

A rod is modelled as a constant distance between its pins. This takes a fraction of the time of a
body with two joints, one of which closes a loop. It is drawn as a massless body, fixed to one pin
and turned towards the other before rendering.
"""

from collections.abc import Iterable

import mujoco

from bricktwin.plans.geometry import Triple
from bricktwin.plans.mechanism.articulation import Follower, Geared
from bricktwin.twin.engines.conventions import ROD, SHAPE_GROUP, SPINNER, motor_name

FIRM = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of constraints on light shafts between strong motors, the largest that MuJoCo allows:
with its default they give way by whole turns."""


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
    if spec.tendon(ROD + name) is not None:
        name = f"{name}_{len(spec.tendons)}"
    name = ROD + name
    # A rod is a tendon that measures the distance of its pins, and an equality that keeps it.
    tendon = spec.add_tendon(name=name, group=SHAPE_GROUP)
    for end, (carrier, pin) in {"near": near, "far": far}.items():
        site = carrier.add_site(
            name=f"{name}_{end}",
            pos=list(pin),
            group=SHAPE_GROUP,
        )
        tendon.wrap_site(site.name)
    _keep_length(spec, name)
    near_body, near_pin = near
    body: mujoco.MjsBody = near_body.add_body(name=name, pos=list(near_pin))
    return body


def add_spinner(
    body: mujoco.MjsBody,
    number: int,
    follower: Follower,
    at_m: Triple,
) -> mujoco.MjsBody:
    """Add a body that turns with a motor, on which its parts are drawn."""
    # The name says which port turns the body, and the user data by how much. A kept model preserves
    # both, and `TurningParts` reads them from there.
    axis = -follower.axis
    ratio_and_axis = [follower.ratio, *axis.tolist()]
    return body.add_body(
        name=f"{SPINNER}{follower.port}_{number}",
        pos=at_m,
        userdata=ratio_and_axis,
    )


def add_coupling(
    spec: mujoco.MjSpec,
    geared: Geared,
    name: str,
    joint: str,
    *,
    is_loaded: bool = False,
) -> None:
    """Couple a joint to that of the motor that it is geared to; ``is_loaded``: it carries the
    robot."""
    constraint = spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
    )
    constraint.name1 = joint
    constraint.name2 = motor_name(geared.port)
    # The data are the coefficients of a polynomial in the motor's angle, and a ratio is its linear
    # term.
    constraint.data[:5] = [0.0, geared.ratio, 0.0, 0.0, 0.0]
    if is_loaded:
        _stiffen(spec, constraint)


def add_gears(
    spec: mujoco.MjSpec,
    name: str,
    joints: Iterable[tuple[str, float]],
) -> None:
    """Keep the sum of the angles of joints, each times its coefficient, as it initially is."""
    # A tendon over joints has that sum as its length.
    tendon = spec.add_tendon(name=name, group=SHAPE_GROUP)
    for joint, coefficient in joints:
        tendon.wrap_joint(joint, coefficient)
    constraint = _keep_length(spec, name)
    constraint.solimp = FIRM


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
    _stiffen(spec, constraint)


def _keep_length(spec: mujoco.MjSpec, tendon: str) -> mujoco.MjsEquality:
    """Keep a tendon at its initial length."""
    constraint = spec.add_equality(
        name=tendon,
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
    )
    constraint.name1 = tendon
    # With zeros as its polynomial, the tendon keeps the length of the initial configuration.
    constraint.data[:5] = 0.0
    _stiffen(spec, constraint)
    return constraint


def _stiffen(spec: mujoco.MjSpec, constraint: mujoco.MjsEquality) -> None:
    """Make a constraint stiffer than MuJoCo's default, with which the ends of a light rod separate
    by fractions of a millimetre, and a light leg behind gears gives way by half a radian."""
    # A time constant of two steps is the stiffest that MuJoCo allows.
    constraint.solref = [2 * spec.option.timestep, 1.0]
    constraint.solimp = [0.99, 0.99, 0.001, 0.5, 2.0]
