"""Physics of a twin: parameters that differ between real robots, and their ranges for domain
randomization."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brickhub.errors import TwinError
from brickhub.files import reading, write_durably
from brickhub.hub.link.profiles import DEFAULT_LINK, PROFILES, LinkProfile

if TYPE_CHECKING:
    from brickhub.virtual.body import Rng

FITTED = ("battery_v", "friction_scale", "motor_friction_scale", "mass_scale", "backlash_deg")
"""Parameters that motion can identify."""

Range = tuple[float, float]


@dataclass(frozen=True)
class Parameter:
    """Properties of one field of :class:`Physics`.

    Attributes:
        unit: unit of the value; "1" for a factor.
        random_range: lowest and highest value of domain randomization.
        allowed_range: lowest and highest allowed value.
        source: source of the default and the range.
    """

    unit: str
    random_range: Range
    allowed_range: Range
    source: str


DRAWN_LINKS = (PROFILES["mac"], PROFILES["linux"])
"""Links of domain randomization: those of ordinary computers."""
DRAWN_CABLES = (PROFILES["usb-quick"], PROFILES["usb"], PROFILES["usb-slow"])
"""Those of a hub that only a cable reaches."""


def _parameter(
    default: float,
    unit: str,
    random_range: Range,
    allowed_range: Range,
    source: str,
) -> Any:
    return dataclasses.field(
        default=default,
        metadata={
            "parameter": Parameter(
                unit,
                random_range,
                allowed_range,
                source,
            )
        },
    )


_ACCELERATION_BIAS = (
    (-184.0, 184.0),
    (-1000.0, 1000.0),
    "120 to 184 mm/s2 on Prime hubs, not calibrated; by default calibrated",
)


def _motor_scale() -> Any:
    return _parameter(
        1.0,
        "1",
        (0.85, 1.15),
        (0.1, 2.0),
        "LEGO's data sheets: speeds within 15 %",
    )


def _link_parameter(
    name: str,
    unit: str,
    allowed_range: Range,
    source: str,
) -> Any:
    """A number of the link's profile. Randomization draws one of ``DRAWN_LINKS``, with all its
    numbers."""
    drawn = [getattr(link, name) for link in DRAWN_LINKS]
    return _parameter(
        default=getattr(PROFILES[DEFAULT_LINK], name),
        unit=unit,
        random_range=(min(drawn), max(drawn)),
        allowed_range=allowed_range,
        source=source,
    )


@dataclass(frozen=True)
class Physics:
    """Parameters of a twin; the defaults are a freshly charged robot on a smooth floor. Raises
    TwinError if a value is outside of its allowed range.

    By default sensors have noise, but no bias, as offsets have either sign and a mean of 0, and
    never fail.

    Attributes:
        battery_v: voltage of the battery without load, by its charge; it limits the motors'.
        battery_ohm: resistance of the battery with its protection and contacts: its voltage sags
            under the motors' load.
        friction_scale: factor on the friction between tyres and floor.
        mass_scale: factor on all masses and inertias.
        motor_friction_scale: factor on the dry friction inside the motors.
        backlash_deg: backlash between motor and wheel, to either side, of a SPIKE motor; an EV3
            large motor has 0.6 of it, a medium one 0.1.
        encoder_resolution_deg: step of a motor's rotation sensor.
        distance_noise_mm: standard deviation of the ultrasonic sensor at zero distance.
        distance_noise_ratio: increase of this deviation per millimetre of distance.
        distance_bias_mm: offset of the ultrasonic sensor.
        distance_dropout_share: share of its readings that are the largest whatever is ahead.
        echo_angle_deg: largest angle to a hard surface's normal at which the surface throws sound
            back.
        soft_range_mm: distance from which on it sees something soft.
        tilt_noise_deg: standard deviation of pitch and roll.
        gyro_noise_deg_s: standard deviation of each axis of the gyroscope.
        gyro_scale_error_pct: what the gyroscope reads for a turn, beyond the turn.
        gyro_drift_deg_min: heading that the gyroscope adds by itself; that of an EV3 sensor adds
            ten times of it.
        acceleration_noise_mm_s2: standard deviation of each axis of the accelerometer.
        acceleration_bias_x_mm_s2, acceleration_bias_y_mm_s2, acceleration_bias_z_mm_s2: offset of
            each axis of the accelerometer, in the hub's frame; it tilts pitch and roll, too.
        color_noise_pct: standard deviation of the light reflected to a color sensor.
        link_interval_ms, link_jitter_ms, link_wake_ms: delays of Bluetooth, as in
            :class:`~brickhub.hub.link.profiles.LinkProfile`.
        link_loss, link_burst_ms, link_lost_notifications: losses, as there.
        slope_deg: slope of the floor, uphill along x, the direction in which robots start.
        wheel_difference_pct: by how much the left wheel of a drive base is larger than the right
            one.
        side_load_g: mass fastened to the left side of the chassis, 6 modules from its centre of
            mass.
        motor_1_scale ... motor_6_scale: factor on the speed, free or loaded, of each motor in the
            order of the description.
    """

    battery_v: float = _parameter(
        8.0,
        "V",
        (7.2, 8.3),
        (6.0, 9.0),
        "two lithium cells, 8.3 V charged, 7.2 V nominal; the hub switches off at 6 V",
    )
    battery_ohm: float = _parameter(
        0.2,
        "ohm",
        (0.1, 0.4),
        (0.0, 0.5),
        "estimate: two cells of 50 mohm, the rest protection, contacts and wires",
    )
    friction_scale: float = _parameter(
        1.0,
        "1",
        (0.7, 1.2),
        (0.05, 3.0),
        "estimate: rubber on wood, laminate, a dusty floor",
    )
    mass_scale: float = _parameter(
        1.0,
        "1",
        (0.9, 1.15),
        (0.3, 3.0),
        "parts are estimated; 10 % for cables and other bricks",
    )
    motor_friction_scale: float = _parameter(
        1.0,
        "1",
        (0.7, 1.5),
        (0.0, 5.0),
        "estimate: new and worn motors",
    )
    backlash_deg: float = _parameter(
        2.5,
        "deg",
        (0.0, 4.0),
        (0.0, 10.0),
        "estimate: gears of a medium motor, axle in its hole",
    )
    encoder_resolution_deg: float = _parameter(
        1.0,
        "deg",
        (1.0, 1.0),
        (0.001, 10.0),
        "motors report whole degrees; the same in every motor, so never drawn",
    )
    distance_noise_mm: float = _parameter(
        1.0,
        "mm",
        (0.5, 3.0),
        (0.0, 50.0),
        "estimate: readings of a still wall",
    )
    distance_noise_ratio: float = _parameter(
        0.004,
        "1",
        (0.002, 0.008),
        (0.0, 0.2),
        "estimate: a wall far off against one nearby",
    )
    distance_bias_mm: float = _parameter(
        0.0,
        "mm",
        (-20.0, 20.0),
        (-200.0, 200.0),
        "LEGO's technical fact sheet of 45604: +-20 mm; by default exact",
    )
    distance_dropout_share: float = _parameter(
        0.0,
        "1",
        (0.0, 0.03),
        (0.0, 1.0),
        "estimate: owners tell of 2000 before a wall (pybricks/support#39, #476), not how often",
    )
    echo_angle_deg: float = _parameter(
        35.0,
        "deg",
        (25.0, 50.0),
        (0.0, 90.0),
        "estimate: LEGO's technical fact sheet of 45604 gives a field of view of +-35 deg",
    )
    soft_range_mm: float = _parameter(
        1500.0,
        "mm",
        (1200.0, 1800.0),
        (0.0, 2000.0),
        "LEGO: soft objects from 150 cm; the range is an estimate",
    )
    tilt_noise_deg: float = _parameter(
        0.3,
        "deg",
        (0.1, 0.6),
        (0.0, 10.0),
        "estimate: a hub at rest",
    )
    gyro_noise_deg_s: float = _parameter(
        0.1,
        "deg/s",
        (0.07, 0.2),
        (0.0, 50.0),
        "data sheet of ST's LSM6DS3TR-C: 5 mdps per root of Hz, up to half its 833 Hz",
    )
    gyro_scale_error_pct: float = _parameter(
        0.0,
        "%",
        (-1.0, 1.0),
        (-5.0, 5.0),
        "363.4 and 362.8 deg for a turn (pybricks/support#1678); by default calibrated",
    )
    gyro_drift_deg_min: float = _parameter(
        0.0,
        "deg/min",
        (-0.4, 0.4),
        (-60.0, 60.0),
        "0.044 deg in 7 s at rest, 0.37 a minute (pybricks/support#2238)",
    )
    acceleration_noise_mm_s2: float = _parameter(
        20.0,
        "mm/s2",
        (10.0, 50.0),
        (0.0, 2000.0),
        "estimate: a hub at rest",
    )
    acceleration_bias_x_mm_s2: float = _parameter(0.0, "mm/s2", *_ACCELERATION_BIAS)
    acceleration_bias_y_mm_s2: float = _parameter(0.0, "mm/s2", *_ACCELERATION_BIAS)
    acceleration_bias_z_mm_s2: float = _parameter(0.0, "mm/s2", *_ACCELERATION_BIAS)
    color_noise_pct: float = _parameter(
        0.5,
        "%",
        (0.2, 1.5),
        (0.0, 20.0),
        "estimate: readings of a still sheet of paper",
    )
    link_interval_ms: float = _link_parameter(
        "interval_ms",
        "ms",
        (0.0, 4000.0),
        "Bluetooth LE allows 7.5 ms to 4 s",
    )
    link_jitter_ms: float = _link_parameter(
        "jitter_ms",
        "ms",
        (0.0, 200.0),
        "estimate: the computer's own time",
    )
    link_loss: float = _link_parameter(
        "loss",
        "1",
        (0.0, 0.45),
        "estimate: packets lost in the air, and sent again",
    )
    link_burst_ms: float = _link_parameter(
        "burst_ms",
        "ms",
        (1.0, 60_000.0),
        "estimate: Wi-Fi and people in between",
    )
    link_lost_notifications: float = _link_parameter(
        "lost_notifications",
        "1",
        (0.0, 0.2),
        "estimate; pybricks/support#320",
    )
    link_wake_ms: float = _link_parameter(
        "wake_ms",
        "ms",
        (0.0, 2000.0),
        "labapart/gattlib#223: up to 300 ms in all",
    )
    slope_deg: float = _parameter(
        0.0,
        "deg",
        (-2.0, 2.0),
        (-30.0, 30.0),
        "estimate: floors and tables are not level",
    )
    wheel_difference_pct: float = _parameter(
        0.0,
        "%",
        (-0.5, 0.5),
        (-10.0, 10.0),
        "estimate: new and worn tyres, one more loaded than the other",
    )
    side_load_g: float = _parameter(
        0.0,
        "g",
        (0.0, 50.0),
        (0.0, 500.0),
        "estimate: a sensor, a motor or a cable more",
    )
    motor_1_scale: float = _motor_scale()
    motor_2_scale: float = _motor_scale()
    motor_3_scale: float = _motor_scale()
    motor_4_scale: float = _motor_scale()
    motor_5_scale: float = _motor_scale()
    motor_6_scale: float = _motor_scale()

    @property
    def motor_scales(self) -> tuple[float, ...]:
        """Factors on the speeds of the motors, in the order of the description; a hub has at most
        six."""
        return (
            self.motor_1_scale,
            self.motor_2_scale,
            self.motor_3_scale,
            self.motor_4_scale,
            self.motor_5_scale,
            self.motor_6_scale,
        )

    def __post_init__(self) -> None:
        for name, parameter in PARAMETERS.items():
            value = getattr(self, name)
            low, high = parameter.allowed_range
            if not (math.isfinite(value) and low <= value <= high):
                unit = "" if parameter.unit == "1" else f" {parameter.unit}"
                raise TwinError(
                    f"physics: {name} is {value}{unit}; give a value from {low} to {high}"
                )

    @property
    def link(self) -> LinkProfile:
        """The link's delays and losses."""
        # Each field of a profile has a parameter of its name.
        values = {}
        for part in dataclasses.fields(LinkProfile):
            values[part.name] = getattr(self, f"link_{part.name}")
        return LinkProfile(**values)

    def with_link(self, link: LinkProfile) -> Physics:
        """The same physics with another link."""
        values = {}
        for name, value in dataclasses.asdict(link).items():
            values[f"link_{name}"] = value
        return dataclasses.replace(self, **values)

    @classmethod
    def from_dict(cls, data: object) -> Physics:
        """Physics from a dict of parameters; others keep their defaults. Raises TwinError if a name
        is unknown, or a value is no number or out of range."""
        if not isinstance(data, dict):
            raise TwinError(
                "physics: this is not a table of names and numbers; give one such as "
                '{"battery_v": 7.4}'
            )
        for name, value in data.items():
            if name not in PARAMETERS:
                raise TwinError(
                    f"physics: there is no parameter '{name}'; choose from {', '.join(PARAMETERS)}"
                )
            # JSON's true and false are numbers to Python.
            if not isinstance(value, (int, float)) or isinstance(value, bool):
                raise TwinError(f"physics: {name} is {value!r}; give a number")
        return cls(**data)


PHYSICS_REMEDY = "give a JSON file that `bricktwin twin fit` wrote"
"""What to do where a file of physics cannot be read."""


def read_physics(path: Path) -> Physics:
    """Read the parameters from a JSON file such as ``bricktwin twin fit`` writes. Raises TwinError
    if the file cannot be read, or its content is invalid."""
    with reading(
        "the physics in",
        path,
        TwinError,
        PHYSICS_REMEDY,
    ):
        return Physics.from_dict(json.loads(path.read_bytes()))


def write_physics(path: Path, physics: Physics) -> None:
    """Write all parameters to a JSON file; its folder is created. Raises WriteError if that is
    impossible."""
    text = json.dumps(dataclasses.asdict(physics), indent=2)
    write_durably(path, f"{text}\n".encode())


PARAMETERS: dict[str, Parameter] = {
    field.name: field.metadata["parameter"] for field in dataclasses.fields(Physics)
}
"""Properties of every field of :class:`Physics`, by name."""


@dataclass(frozen=True)
class RandomPhysics:
    """Sampler of a :class:`Physics` for every episode (domain randomization). Raises TwinError if
    the width is not in 0..1.

    Attributes:
        width: 1 draws each parameter uniformly from its whole range, and one of the links; 0 keeps
            the defaults.
        links: from which one is drawn.
    """

    width: float = 1.0
    links: tuple[LinkProfile, ...] = DRAWN_LINKS

    def __post_init__(self) -> None:
        if not 0.0 <= self.width <= 1.0:
            raise TwinError(f"random physics: width is {self.width}; give a value from 0 to 1")

    def sample(self, rng: Rng) -> Physics:
        """Draw the parameters."""
        nominal = Physics()
        # The numbers of a link belong together: one link is drawn, and not each of its numbers.
        count = len(self.links)
        # 1 is a possible draw, as a generator's upper end may be its own.
        number = int(rng.uniform(0.0, 1.0) * count) % count
        drawn_link = nominal.with_link(self.links[number])
        values = {}
        for name, parameter in PARAMETERS.items():
            low, high = parameter.random_range
            if name.startswith("link_"):
                low = high = getattr(drawn_link, name)
            # Ranges shrink towards the defaults. A number is drawn for each parameter, also where
            # it has no range: the others must not depend on that.
            default = getattr(nominal, name)
            values[name] = rng.uniform(
                default + self.width * (low - default),
                default + self.width * (high - default),
            )
        return Physics(**values)
