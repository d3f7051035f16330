"""Rods: bars with a pin at either end, modelled as a constant distance between the pins.

This takes a fraction of the time of a body with two joints, one of which closes a loop. A rod is drawn as a massless body, fixed
to one pin and turned towards the other before rendering.
"""

from __future__ import annotations

import mujoco

from bricktwin.plans.geometry import Triple
from bricktwin.twin.models.mjcf import SHAPE_GROUP

_PREFIX = "rod_"


def add_rod(
    spec: mujoco.MjSpec, name: str, near: tuple[mujoco.MjsBody, Triple], far: tuple[mujoco.MjsBody, Triple]
) -> mujoco.MjsBody:
    """Join two bodies, each given with its pin's position, by a rod of the pins' distance in the initial configuration.

    It has no mass: the bodies carry half of it each. Several rods may have one name, which gets a number.

    Returns:
        The body to draw the rod on: its origin is the near pin, its z axis points to the far one.
    """
    name = _PREFIX + (name if spec.tendon(_PREFIX + name) is None else f"{name}_{len(spec.tendons)}")
    tendon = spec.add_tendon(name=name, group=SHAPE_GROUP)
    for end, (carrier, pin) in {"near": near, "far": far}.items():
        tendon.wrap_site(carrier.add_site(name=f"{name}_{end}", pos=list(pin), group=SHAPE_GROUP).name)
    constraint = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON)
    constraint.name1, constraint.data[:5] = name, 0.0
    # Stiff: with MuJoCo's default the ends of a light rod separate by fractions of a millimetre.
    constraint.solref, constraint.solimp = [2 * spec.option.timestep, 1.0], [0.99, 0.99, 0.001, 0.5, 2.0]
    body: mujoco.MjsBody = near[0].add_body(name=name, pos=list(near[1]))
    return body


class Rods:
    """Drawn rods of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        sites = {model.site(site).name: site for site in range(model.nsite)}
        names = {body: model.body(body).name for body in range(model.nbody)}
        rods = {body: name for body, name in names.items() if name.rpartition("/")[2].startswith(_PREFIX)}  # "ROBOT/" in an arena
        ends = ((body, sites.get(f"{name}_far")) for body, name in rods.items())
        self._ends = [(body, far) for body, far in ends if far is not None]  # a user's model may have bodies of such names

    def turn(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Turn each to its far pin; positions must be up to date, and are so afterwards."""
        if not self._ends:
            return
        for body, far in self._ends:
            frame = data.xmat[model.body_parentid[body]].reshape(3, 3)
            mujoco.mju_quatZ2Vec(model.body_quat[body], (data.site_xpos[far] - data.xpos[body]) @ frame)
        mujoco.mj_kinematics(model, data)
