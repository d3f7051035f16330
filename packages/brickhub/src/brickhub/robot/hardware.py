"""Hubs, motors and sensors of LEGO: one row for each kind, with what everybody needs to know of it.

Sources: Pybricks 4, its documentation, the configurations of its firmware
(``bricks/*/mpconfigport.h``), its list of devices (``lego_device_type_id_t``); sizes of stacks and
frames from the firmware compiled for each hub with GCC 12 and ``-fstack-usage``.
"""

import enum
from dataclasses import dataclass, replace
from typing import Any, Self

from brickhub.errors import hint


class KindType(enum.EnumType):
    """Type of an enumeration that names its members where a name is wrong."""

    def __getattr__(cls, name: str) -> Any:
        # Python and its tools ask every object for names such as `__wrapped__`.
        if name.startswith("_"):
            raise AttributeError(name)
        names = list(cls.__members__)
        raise AttributeError(
            f"there is no {cls.__name__}.{name}{hint(name, names)}; choose {', '.join(names)}"
        )


class _Kind(enum.Enum, metaclass=KindType):
    """Kind of a device: ``model`` is its row, ``value`` the name in it."""

    _value_: str
    model: Any

    def __new__(cls, model: Any) -> Self:
        # The name is the value of each member, so that files and messages name a kind and
        # `HubKind("prime")` finds it.
        kind = object.__new__(cls)
        kind._value_ = model.name
        kind.model = model
        return kind


USUAL_HUB_NAME = "Pybricks Hub"
"""What a hub is called until somebody gives it a name when Pybricks is installed."""


@dataclass(frozen=True)
class HubModel:
    """Properties of a kind of hub.

    Attributes:
        class_name, alias: class in ``pybricks.hubs``, and its other name if it has one.
        product_id: number by which it identifies itself to this computer.
        firmware_name: first part of ``pybricks.version``.
        machine: name and processor, as ``usys.implementation`` tells them.
        ports: names of the ports for motors and sensors, a character each: a letter, or the number
            of a port that a program calls ``Port.S1``.
        sensor_ports: those for sensors only, if it has such; the others then take motors only.
        port_aliases: further names of ports in a program, each with the port.
        devices: module of ``pybricks`` with the classes of the motors and sensors that fit its
            ports.
        usual_motor: name of the kind of motor that a bench takes for a program's ``Motor``.
        own_motors: those at which it has motors of its own, and ``own_kind``: the name of their
            kind.
        program_bytes: largest size of a user program, which is the memory for stored data and the
            heap too, unless ``block_bytes`` says that memory.
        stdin_bytes: usable size of the standard input ring buffer up to Pybricks 4.0; 0 means no
            stdin.
        packet_bytes: largest packet over Bluetooth (``PBDRV_BLUETOOTH_MAX_MTU_SIZE``, less 3),
            which the buffer takes since 4.1.
        has_hub_network: whether its firmware has ``HubNetwork`` since Pybricks 4.1.
        stack_bytes, call_bytes: size of the call stack, which is what static data leaves of the
            memory, and of a call's frame.
        stored_bytes: user data, settings and slots.
        storage_bytes: user data that ``hub.system.storage`` keeps.
        product_us: time of a product of floats that is added to a sum. Nobody has measured it on a
            hub: inferred from five to seven steps of byte code and two objects on the heap at 96
            MHz, 8 to 15 us (a Prime hub runs about half the pystones of a pyboard,
            pybricks/support#718 and micropython#4858); for others in proportion to their clocks.
        has_imu: whether a gyroscope and an accelerometer report tilt and angular velocity.
        has_accelerometer: whether there is an accelerometer only.
        has_float: whether the hub's MicroPython has floating-point numbers; one without is small,
            and has no streams either.
        has_display, has_speaker: whether there are a display of 5 x 5 pixels and a loudspeaker.
        screen_pixels: width and height of its screen, which shows images; ``None`` without one.
        is_rechargeable: whether it has a lithium battery with a charger rather than cells.
        has_bluetooth: whether a computer can reach it over Bluetooth, and not over USB only.
        buttons: names of its buttons; ``stop_button``: the one that stops a program, unless that
            chooses others.
        peripherals: number of wireless devices that it can hold
            (``PBDRV_CONFIG_BLUETOOTH_NUM_PERIPHERALS``).
        ran_pybricks_2: whether Pybricks 1 and 2 ran on it, whose programs are still around.
        missing: builtin names, and classes of wireless devices, that its firmware leaves out.
    """

    name: str
    class_name: str
    product_id: int
    ports: str
    sensor_ports: str = ""
    port_aliases: tuple[tuple[str, str], ...] = ()
    devices: str = "pupdevices"
    usual_motor: str = "spike-medium"
    firmware_name: str = ""
    machine: str = ""
    program_bytes: int = 0
    block_bytes: int = 0
    stdin_bytes: int = 0
    stack_bytes: int = 0
    call_bytes: int = 0
    stored_bytes: int = 200
    storage_bytes: int = 128
    packet_bytes: int = 0
    has_hub_network: bool = False
    product_us: int = 12
    has_imu: bool = False
    has_accelerometer: bool = False
    has_float: bool = True
    has_display: bool = False
    has_speaker: bool = False
    screen_pixels: tuple[int, int] | None = None
    is_rechargeable: bool = False
    has_bluetooth: bool = True
    buttons: tuple[str, ...] = ("center",)
    stop_button: str = "center"
    peripherals: int = 1
    ran_pybricks_2: bool = False
    missing: tuple[str, ...] = ()
    alias: str = ""
    own_motors: str = ""
    own_kind: str = ""

    @property
    def runs_programs(self) -> bool:
        """Whether a program of ours can run on it; a device that runs none only obeys its commands
        over Bluetooth."""
        return self.program_bytes > 0

    @property
    def memory_bytes(self) -> int:
        """Memory for stored data and the heap."""
        return self.block_bytes or self.program_bytes

    @property
    def motor_ports(self) -> str:
        """Names of the ports that take motors."""
        return "".join(port for port in self.ports if port not in self.sensor_ports)

    @property
    def ports_for_sensors(self) -> str:
        """Names of the ports that take sensors."""
        return self.sensor_ports or "".join(
            port for port in self.ports if port not in self.own_motors
        )

    def takes(self, device: "MotorModel | SensorModel") -> str:
        """Names of the ports that a motor or sensor fits; empty for one with another plug."""
        if device.module != self.devices:
            return ""
        if isinstance(device, MotorModel):
            return self.motor_ports
        return self.sensor_ports or self.ports


def port_name(port: str) -> str:
    """Name of a port in a program, as a member of ``Port``."""
    return f"S{port}" if port.isdigit() else port


# The firmware of the smaller hubs leaves out the classes of these wireless devices.
_RARE_DEVICES = ("DuploTrain", "MarioHub", "TechnicMoveHub")


class HubKind(_Kind):
    """Hubs supported by Pybricks 4 (except the NXT brick)."""

    model: HubModel

    PRIME = HubModel(
        "prime",
        "PrimeHub",
        product_id=0x81,
        machine="SPIKE Prime Hub with STM32F413VG",
        ports="ABCDEF",
        program_bytes=272 * 1024,
        stdin_bytes=63,
        packet_bytes=512,
        has_hub_network=True,
        stack_bytes=15_412,
        call_bytes=208,
        stored_bytes=600,
        storage_bytes=512,
        has_imu=True,
        has_display=True,
        has_speaker=True,
        is_rechargeable=True,
        buttons=("center", "left", "right", "bluetooth"),
        peripherals=2,
        alias="InventorHub",
    )
    ESSENTIAL = HubModel(
        "essential",
        "EssentialHub",
        product_id=0x83,
        machine="SPIKE Essential Hub with STM32F413RG",
        ports="AB",
        program_bytes=258 * 1024,
        stdin_bytes=63,
        packet_bytes=512,
        has_hub_network=True,
        stack_bytes=36_400,
        call_bytes=216,
        stored_bytes=600,
        storage_bytes=512,
        has_imu=True,
        is_rechargeable=True,
        peripherals=2,
    )
    TECHNIC = HubModel(
        "technic",
        "TechnicHub",
        product_id=0x80,
        machine="Technic Hub with STM32L431RC",
        ports="ABCD",
        program_bytes=32 * 1024,
        stdin_bytes=20,
        packet_bytes=155,
        stack_bytes=22_968,
        call_bytes=208,
        product_us=15,
        has_imu=True,
        missing=("memoryview", *_RARE_DEVICES),
    )
    CITY = HubModel(
        "city",
        "CityHub",
        product_id=0x41,
        machine="Powered Up City Hub with STM32F030RC",
        ports="AB",
        program_bytes=20 * 1024,
        stdin_bytes=20,
        packet_bytes=155,
        stack_bytes=6_688,
        call_bytes=224,
        product_us=30,
        missing=("memoryview", "XboxController", *_RARE_DEVICES),
    )
    MOVE = HubModel(
        "move",
        "MoveHub",
        product_id=0x40,
        machine="BOOST Move Hub with STM32F070RB",
        ports="ABCD",
        own_motors="AB",
        own_kind="move-hub",
        program_bytes=7 * 1024,
        # This hub has no standard input, which takes 0 bytes by default, so no program of ours can
        # hear its host.
        stack_bytes=3_528,
        call_bytes=232,
        has_accelerometer=True,
        has_float=False,
        missing=(
            "bytearray",
            "complex",
            "enumerate",
            "float",
            "input",
            "memoryview",
            "open",
            "reversed",
            "set",
            *_RARE_DEVICES,
        ),
    )
    EV3 = HubModel(
        "ev3",
        "EV3Brick",
        product_id=0xE2,
        firmware_name="ev3",
        machine="MINDSTORMS EV3 Brick with TI Sitara AM1808",
        ports="ABCD1234",
        sensor_ports="1234",
        # For programs that were written for a SPIKE hub.
        port_aliases=(("E", "1"), ("F", "2")),
        devices="ev3devices",
        usual_motor="ev3-large",
        # Its flash memory has room for four programs (`pbdrvconfig.h`).
        program_bytes=196_468,
        block_bytes=1024 * 1024,
        stdin_bytes=20,
        # The linker leaves at least this much of 64 MiB.
        stack_bytes=4 * 1024 * 1024,
        call_bytes=208,
        stored_bytes=556,
        storage_bytes=512,
        # Its ARM9 has 300 MHz, but no unit for floats.
        product_us=6,
        has_speaker=True,
        screen_pixels=(178, 128),
        has_bluetooth=False,
        buttons=("center", "left", "right", "up", "down", "left_up"),
        stop_button="left_up",
        peripherals=0,
        ran_pybricks_2=True,
        missing=("LWP3Device", "XboxController"),
        alias="PrimeHub",
    )


class KitKind(_Kind):
    """Devices of LEGO's kits of 2026 that carry a robot's motors as a hub does; ``class_name`` is
    that in LEGO's package.

    The robot's other devices are on the other ports, over the air: each motor a Single Motor, each
    color sensor a Color Sensor.
    """

    model: HubModel

    DOUBLE_MOTOR = HubModel(
        "double-motor",
        "DoubleMotor",
        product_id=513,
        ports="ABCDEF",
        own_motors="AB",
        own_kind="spike-medium",
        has_imu=True,
        is_rechargeable=True,
        buttons=(),
    )
    """The Double Motor, whose left motor is on port A and whose right one is on port B."""
    SINGLE_MOTOR = replace(
        DOUBLE_MOTOR,
        name="single-motor",
        class_name="SingleMotor",
        product_id=512,
        own_motors="A",
        has_imu=False,
    )


AnyHub = HubKind | KitKind
"""Kinds of devices that carry the other devices of a robot."""


@dataclass(frozen=True)
class MotorModel:
    """Properties of a kind of motor; its model in the firmware is in
    ``virtual/firmware/motor_model.py``.

    Attributes:
        device_id: number by which it identifies itself to a hub.
        module: module of ``pybricks`` that has its class; hubs that name the same one take it.
        like: name of the kind that it is in another colour, or for the hub; for one without
            encoder, the kind that a twin takes for it, as the firmware has no model of it.
        case: name of the kind whose case a twin gives it, if it has none of its own, as one inside
            of a hub.
        is_absolute: whether its rotation sensor knows the shaft's angle after plugging in.
        has_encoder: whether it has a rotation sensor; without one, it takes only a duty cycle.
        is_two_sided: whether its shaft goes through, so that one on the left and one on the right
            are mounted alike; others are mounted the other way round.
    """

    name: str
    device_id: int
    module: str = "pupdevices"
    like: str = ""
    case: str = ""
    is_absolute: bool = True
    has_encoder: bool = True
    is_two_sided: bool = False

    @property
    def class_name(self) -> str:
        """Class in its module."""
        return "Motor" if self.has_encoder else "DCMotor"


class MotorKind(_Kind):
    """Motors, with or without a rotation sensor."""

    model: MotorModel

    SPIKE_SMALL = MotorModel("spike-small", 65)
    SPIKE_MEDIUM = MotorModel("spike-medium", 48)
    SPIKE_LARGE = MotorModel("spike-large", 49)
    TECHNIC_M_ANGULAR = MotorModel("technic-m-angular", 75, like="spike-medium")
    TECHNIC_L_ANGULAR = MotorModel("technic-l-angular", 76, like="spike-large")
    TECHNIC_L = MotorModel("technic-l", 46)
    TECHNIC_XL = MotorModel("technic-xl", 47)
    INTERACTIVE = MotorModel("interactive", 38, is_absolute=False)
    MOVE_HUB = MotorModel(
        "move-hub",
        39,
        case="interactive",
        is_absolute=False,
    )
    # Plain motors have no encoder, so a hub can only set their duty cycle.
    MEDIUM_LINEAR = MotorModel(
        "medium-linear",
        1,
        like="technic-l",
        has_encoder=False,
    )
    TRAIN = MotorModel(
        "train",
        2,
        like="technic-l",
        has_encoder=False,
    )
    EV3_LARGE = MotorModel(
        "ev3-large",
        86,
        "ev3devices",
        is_absolute=False,
        is_two_sided=True,
    )
    EV3_MEDIUM = MotorModel("ev3-medium", 87, "ev3devices", is_absolute=False)
    # An EV3 Brick measures nearly the same voltage at its plug as at that of the large motor, and
    # takes it for one.
    NXT = MotorModel(
        "nxt-motor",
        86,
        "ev3devices",
        like="ev3-large",
        is_absolute=False,
        is_two_sided=True,
    )


class Sense(enum.StrEnum):
    """Kind of stimulus.

    SURFACE: look of a surface in the sensor's light: a color, or the brightness of a gray in %.
    AMBIENT: incoming light while the sensor's is off, likewise.
    DISTANCE: mm for the ultrasonic sensor, % for infrared sensors.
    FORCE: N on the button.
    TILT: pitch and roll, degrees.
    COUNT: number of passed objects.
    ROTATION: angle about the sensor's axis, clockwise seen from above, in degrees, and its rate
        in deg/s.
    BEACON: distance of an infrared beacon in %, and its direction in degrees, to the right
        positive.
    """

    SURFACE = "surface"
    AMBIENT = "ambient"
    DISTANCE = "distance"
    FORCE = "force"
    TILT = "tilt"
    COUNT = "count"
    ROTATION = "rotation"
    BEACON = "beacon"


REMOTE_BUTTONS = ("left_plus", "left", "left_minus", "right_plus", "right", "right_minus", "center")
"""Names of the buttons of the Powered Up remote."""


@dataclass(frozen=True)
class SensorModel:
    """Properties of a kind of sensor or light; its modes are in
    ``virtual/pybricks/device_modes.py``.

    Attributes:
        name: that of its class, unless sensors of two families have one of that name.
        device_id: number by which it identifies itself to a hub.
        senses: what it senses; a scene names the first one by the sensor alone. Empty for a light.
        readings: methods that return measurements, as numbers or booleans, for a ``SensorReading``.
        range_mm: least and largest distance in mm, for a ``Distance``; ``None`` for a sensor that
            does not measure millimetres.
        light: call that sets the brightness of its light in %, for a ``LightBrightness``; empty
            without one.
        module: module of ``pybricks`` that has its class; hubs that name the same one take it.
    """

    name: str
    device_id: int
    senses: tuple[Sense, ...] = ()
    readings: tuple[str, ...] = ()
    range_mm: tuple[int, int] | None = None
    light: str = ""
    module: str = "pupdevices"

    @property
    def class_name(self) -> str:
        """Class in its module."""
        return self.name.removeprefix("Ev3")


class SensorKind(_Kind):
    """Sensors and lights of ``pybricks.pupdevices`` and ``pybricks.ev3devices``."""

    model: SensorModel

    # The distance has a noise of its own in a twin, so it is a `Distance` and no plain reading.
    ULTRASONIC = SensorModel(
        "UltrasonicSensor",
        62,
        (Sense.DISTANCE,),
        range_mm=(40, 2000),
        light="lights.on",
    )
    COLOR = SensorModel(
        "ColorSensor",
        61,
        (Sense.SURFACE, Sense.AMBIENT),
        ("reflection", "ambient", "hsv"),
    )
    COLOR_DISTANCE = SensorModel(
        "ColorDistanceSensor",
        37,
        (Sense.SURFACE, Sense.DISTANCE, Sense.AMBIENT),
        ("reflection", "ambient", "hsv", "distance"),
    )
    FORCE = SensorModel(
        "ForceSensor",
        63,
        (Sense.FORCE,),
        ("force", "distance", "pressed", "touched"),
    )
    INFRARED = SensorModel(
        "InfraredSensor",
        35,
        (Sense.DISTANCE, Sense.COUNT),
        ("reflection", "distance", "count"),
    )
    TILT = SensorModel(
        "TiltSensor",
        34,
        (Sense.TILT,),
        ("tilt",),
    )
    LIGHT = SensorModel("Light", 8, light="on")
    COLOR_LIGHT_MATRIX = SensorModel("ColorLightMatrix", 64)
    EV3_TOUCH = SensorModel(
        "Ev3TouchSensor",
        85,
        (Sense.FORCE,),
        ("pressed",),
        module="ev3devices",
    )
    EV3_COLOR = SensorModel(
        "Ev3ColorSensor",
        29,
        (Sense.SURFACE, Sense.AMBIENT),
        ("reflection", "ambient", "rgb"),
        module="ev3devices",
    )
    EV3_ULTRASONIC = SensorModel(
        "Ev3UltrasonicSensor",
        30,
        (Sense.DISTANCE,),
        range_mm=(30, 2550),
        module="ev3devices",
    )
    EV3_GYRO = SensorModel(
        "Ev3GyroSensor",
        32,
        (Sense.ROTATION,),
        ("angle", "speed"),
        module="ev3devices",
    )
    EV3_INFRARED = SensorModel(
        "Ev3InfraredSensor",
        33,
        (Sense.DISTANCE, Sense.BEACON),
        ("distance",),
        module="ev3devices",
    )
