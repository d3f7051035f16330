"""Engine under a body: what a twin needs of MuJoCo, whether that is its Python or its JavaScript
build.

Fields have MuJoCo's own names (its API reference explains them), and are flat: the position of body
2 is ``xpos[6:9]``. Lengths are metres, angles radians.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol, TypeAlias

from bricktwin.twin.engines.rotations import Vector

Values: TypeAlias = "memoryview[float]"
Kind = Literal["body", "joint", "geom", "site", "actuator", "sensor"]
"""What has names in a model."""


class Hit(NamedTuple):
    """What a ray meets: its distance, the geometry's index, and the surface's normal."""

    distance_m: float
    geom: int
    normal: Vector


class Touch(NamedTuple):
    """Two geometries in contact; a negative distance is an overlap."""

    first: int
    second: int
    distance_m: float


class Engine(Protocol):
    """Model and state of a robot in its surroundings.

    The fields are views of the present state, and what is written there holds from the next call
    on. ``qacc``, ``actuator_force`` and ``sensordata`` are those of the last step.
    """

    qpos: Values
    qvel: Values
    qacc: Values
    ctrl: Values
    actuator_force: Values
    sensordata: Values
    mocap_pos: Values
    xfrc_applied: Values
    gravity: Values
    open_circuits: int
    """Bits of the actuators' groups that give no torque, MuJoCo's ``disableactuator``."""

    def switch_circuits(self, circuits: int) -> None:
        """Open the closed ones, and close the open ones, of these circuits."""

    # ------------------------------------------------------------ the model

    def names(self, kind: Kind) -> Sequence[str]:
        """Names of all elements of a kind, by index; empty for what has none."""

    def index(self, kind: Kind, name: str) -> int:
        """Index of an element; -1 if there is none of this name."""

    @property
    def nominal_gravity(self) -> Vector:
        """Gravity of the model as it was compiled."""

    def nominal(self, field: str) -> Sequence[float]:
        """A field of the model as it was compiled."""

    def indices(self, field: str) -> Sequence[int]:
        """A field of the model that holds whole numbers: addresses, types, groups."""

    def parameters(self, field: str) -> list[float]:
        """Present numbers of a field of the model."""

    def set_parameters(self, field: str, values: Sequence[float]) -> None:
        """Set all numbers of a field of the model."""

    def derive_constants(self) -> None:
        """Derive what follows from the parameters; the state is not changed."""

    # ------------------------------------------------------------ time

    def step(self, count: int) -> None:
        """Integrate so many steps."""

    def forward(self) -> None:
        """Compute all that follows from the state, without a step."""

    def kinematics(self) -> None:
        """Compute the places of all parts from the positions."""

    def forget(self) -> None:
        """Forget what the solver remembers of the last step, at which it begins."""

    # ------------------------------------------------------------ what follows from the state

    def derived(self, field: str) -> Values:
        """A field that was derived from the state, such as ``"xpos"``; to be read anew after each
        step."""

    def ray(
        self,
        origin_m: Vector,
        direction: Vector,
        groups: tuple[int, ...],
        but_body: int = -1,
    ) -> Hit | None:
        """The nearest geometry of these groups along a ray, without those of one body; ``None`` if
        there is none. ``direction``: of length 1."""

    def touches(self) -> list[Touch]:
        """Contacts of the last step."""

    def site_spin(self, site: int) -> Vector:
        """Angular velocity of a site, in its own axes, rad/s."""

    def site_force(self, site: int) -> Vector:
        """Acceleration of a site minus gravity, in its own axes, m/s2."""
