"""Engine of MuJoCo's JavaScript build, under a body in a tab; ``static/engine.js`` is its other
half.

The state lies in one array here, of which JavaScript has a view: one call between the languages
steps and copies, and reading a number needs none.
"""

from array import array
from collections.abc import Sequence
from typing import Any

from bricktwin.twin.engines.engine import Hit, Kind, Touch, Values
from bricktwin.twin.engines.rotations import Vector, vector


class JsEngine:
    """Engine in JavaScript; implements :class:`bricktwin.twin.engines.engine.Engine`.

    Args:
        handle: its other half, an ``Engine`` of ``engine.js``.
    """

    def __init__(self, handle: Any) -> None:
        # Pyodide's modules exist in a tab only.
        from pyodide.ffi import create_proxy, to_js

        self._handle = handle
        self._to_js = to_js
        # Kept, as each look-up of a method in the other language takes time.
        self._step = handle.step
        self._ray = handle.ray
        sizes: dict[str, int] = handle.sizes().to_py()
        state = array("d", bytes(8 * sum(sizes.values())))
        whole: Any = memoryview(state)
        fields: dict[str, Values] = {}
        place = 0
        for name, size in sizes.items():
            fields[name] = whole[place : place + size]
            place += size
        self.qpos = fields["qpos"]
        self.qvel = fields["qvel"]
        self.qacc = fields["qacc"]
        self.ctrl = fields["ctrl"]
        self.actuator_force = fields["actuator_force"]
        self.sensordata = fields["sensordata"]
        self.mocap_pos = fields["mocap_pos"]
        self.xfrc_applied = fields["xfrc_applied"]
        self.gravity = fields["gravity"]
        self._numbers = create_proxy(state)
        handle.share(self._numbers)
        self.open_circuits = int(handle.circuits)
        self.nominal_gravity = vector(self.gravity)
        self._names: dict[str, list[str]] = {}
        self._nominal: dict[str, list[Any]] = {}

    def switch_circuits(self, circuits: int) -> None:
        self.open_circuits ^= circuits

    def names(self, kind: Kind) -> Sequence[str]:
        names = self._names.get(kind)
        if names is None:
            names = self._names[kind] = self._handle.names(kind).to_py()
        return names

    def index(self, kind: Kind, name: str) -> int:
        return int(self._handle.index(kind, name))

    def nominal(self, field: str) -> Sequence[float]:
        return self._compiled(field)

    def indices(self, field: str) -> Sequence[int]:
        return self._compiled(field)

    def _compiled(self, field: str) -> list[Any]:
        values = self._nominal.get(field)
        if values is None:
            values = self._nominal[field] = self.parameters(field)
        return values

    def parameters(self, field: str) -> list[float]:
        # Before anything changes them, they are the nominal ones.
        values: list[float] = self._handle.field(field).to_py().tolist()
        return values

    def set_parameters(self, field: str, values: Sequence[float]) -> None:
        self._compiled(field)
        self._handle.set(field, self._to_js(array("d", values)))

    def derive_constants(self) -> None:
        self._handle.deriveConstants()

    def step(self, count: int) -> None:
        self._step(count, self.open_circuits)

    def forward(self) -> None:
        self._handle.forward(self.open_circuits)

    def kinematics(self) -> None:
        self._handle.kinematics()

    def forget(self) -> None:
        self._handle.forget()

    def derived(self, field: str) -> Values:
        values: Values = self._handle.derived(field).to_py()
        return values

    def ray(
        self,
        origin_m: Vector,
        direction: Vector,
        groups: tuple[int, ...],
        but_body: int = -1,
    ) -> Hit | None:
        bits = sum(1 << group for group in groups)
        found = self._ray(*origin_m, *direction, bits, but_body)
        if found is None:
            return None
        distance_m, geom, *normal = found.to_py()
        return Hit(distance_m, int(geom), vector(normal))

    def touches(self) -> list[Touch]:
        touches = []
        for first, second, distance_m in self._handle.touches().to_py():
            touches.append(Touch(int(first), int(second), distance_m))
        return touches

    def site_spin(self, site: int) -> Vector:
        return vector(self._handle.siteSpin(site).to_py())

    def site_force(self, site: int) -> Vector:
        return vector(self._handle.siteForce(site).to_py())

    def end(self) -> None:
        """Give MuJoCo's memory back; the engine is of no use any more."""
        self._handle.end()
        self._numbers.destroy()
