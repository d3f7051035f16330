"""Constraints of linkages, as MuJoCo keeps them."""

from __future__ import annotations

import mujoco

from bricktwin.twin.models.linkage import _constraints


def test_pin_within_one_body_leaves_no_rows():
    spec = mujoco.MjSpec()
    parents = {"a": spec.worldbody, "c": spec.worldbody}
    bodies = {}
    for name, parent in parents.items():
        bodies[name] = parent.add_body(name=name, pos=[2.0 * len(bodies), 0.0, 0.0])
        bodies[name].add_joint(name=f"joint_{name}")
    bodies["b"] = bodies["a"].add_body(name="b", pos=[1.0, 0.0, 0.0])
    for body in bodies.values():
        body.mass = 1.0
        body.inertia = [1.0, 1.0, 1.0]
        body.explicitinertial = True
    # The first of these pins joins what no joint moves against each other, so no joint shows in it.
    for first, second in (("a", "b"), ("a", "c")):
        pin = spec.add_equality()
        pin.type = mujoco.mjtEq.mjEQ_CONNECT
        pin.objtype = mujoco.mjtObj.mjOBJ_BODY
        pin.name1 = first
        pin.name2 = second
        pin.data[:3] = [0.5, 0.0, 0.0]
    model = spec.compile()
    gaps, slopes = _constraints(model, mujoco.MjData(model))
    assert gaps.shape == (3,)
    assert slopes.shape == (3, model.nv)
