"""Hand: it pulls a body of a robot's world towards a point of the floor, for as long as it is
held."""

import math

from bricktwin.twin.engines.engine import Engine

_RATE_S = 15.0
"""Frequency of the spring by which it pulls, 1/s, with critical damping for the mass of what is
pulled: 4 cm move a robot, whose tyres have a friction of 1."""
_MOST_WEIGHTS = 2.0
"""Largest force, as a multiple of the weight of what is pulled."""
_STEP_M = 0.002
"""Largest step of what has no mass, in each of the hub's control loops of 5 ms: it pushes a robot
and does not jump over it."""
_GRAVITY_M_S2 = 9.81


class Hand:
    """Hand in the world of an engine; acts anew in each of the hub's control loops."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._roots = engine.indices("body_rootid")
        self._welds = engine.indices("body_weldid")
        self._mocaps = engine.indices("body_mocapid")
        self._held = -1
        self._grip_m: tuple[float, float] | None = None

    def __len__(self) -> int:
        """Number of bodies that it can take, the first of which is the world."""
        return len(self._roots)

    def let_go(self) -> None:
        """Pull nothing any more."""
        # MuJoCo keeps a force until it is set to 0.
        if self._held >= 0:
            self._push(self._held, 0.0, 0.0)
            self._held = -1
        self._grip_m = None

    def pull(
        self,
        body: int,
        x_m: float,
        y_m: float,
    ) -> None:
        """Pull a body, by its number in the model, towards a point."""
        if self._held >= 0:
            self._push(self._held, 0.0, 0.0)
            self._held = -1
        mocap = self._mocaps[body]
        if mocap >= 0:
            self._move(mocap, x_m, y_m)
            return
        root = self._roots[body]
        # A robot is pulled as a whole; of what stands on a fixed base, the part that is gripped.
        if self._welds[root] == 0:
            root = body
        engine = self._engine
        centre = engine.derived("subtree_com")[3 * root : 3 * root + 2]
        speed = engine.derived("cvel")[6 * root + 3 : 6 * root + 5]
        mass_kg = engine.parameters("body_subtreemass")[root]
        # A critically damped spring: m (w^2 x - 2 w v).
        force_x = mass_kg * (_RATE_S**2 * (x_m - centre[0]) - 2.0 * _RATE_S * speed[0])
        force_y = mass_kg * (_RATE_S**2 * (y_m - centre[1]) - 2.0 * _RATE_S * speed[1])
        share = _share(_MOST_WEIGHTS * mass_kg * _GRAVITY_M_S2, force_x, force_y)
        self._push(root, share * force_x, share * force_y)
        self._held = root

    def _move(
        self,
        mocap: int,
        x_m: float,
        y_m: float,
    ) -> None:
        """Let what has no mass, such as a wall, come by itself; it is held where it was gripped."""
        places = self._engine.mocap_pos
        x = places[3 * mocap]
        y = places[3 * mocap + 1]
        if self._grip_m is None:
            self._grip_m = (x_m - x, y_m - y)
        way_x = x_m - self._grip_m[0] - x
        way_y = y_m - self._grip_m[1] - y
        share = _share(_STEP_M, way_x, way_y)
        places[3 * mocap] = x + share * way_x
        places[3 * mocap + 1] = y + share * way_y

    def _push(
        self,
        body: int,
        force_x: float,
        force_y: float,
    ) -> None:
        forces = self._engine.xfrc_applied
        forces[6 * body] = force_x
        forces[6 * body + 1] = force_y


def _share(
    longest: float,
    x: float,
    y: float,
) -> float:
    """Factor, at most 1, that makes a vector no longer than that."""
    return min(1.0, longest / max(math.hypot(x, y), 1e-9))
