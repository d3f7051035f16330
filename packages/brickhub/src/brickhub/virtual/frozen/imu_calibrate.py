"""MicroPython: calibrates the IMU of a hub that a person rolls over its sides, and stores the
result in ``hub.imu.settings``."""

# mypy: ignore-errors
# --- the hub's part ---
from pybricks.hubs import ThisHub
from pybricks.parameters import Axis, Side
from pybricks.tools import vector, wait

ROUNDS = 2
SAMPLES = 1000
# Where the acceleration of a side that is up is kept, and its component.
PLACES = {
    Side.FRONT: (0, 0),
    Side.BACK: (1, 0),
    Side.LEFT: (2, 1),
    Side.RIGHT: (3, 1),
    Side.TOP: (4, 2),
    Side.BOTTOM: (5, 2),
}
# Axis, its name, how to begin, and the sides that are up one after another.
TURNS = (
    (
        Axis.X,
        "X now!",
        "- top side (display) facing up\n- right side (ports BDF) towards you.",
        (Side.TOP, Side.LEFT, Side.BOTTOM, Side.RIGHT),
    ),
    (
        Axis.Y,
        "Y now",
        "- top side (display) facing up\n- back side (speaker) towards you.",
        (Side.TOP, Side.FRONT, Side.BOTTOM, Side.BACK),
    ),
    (
        Axis.Z,
        "Z now!",
        "- front side (USB port) facing up\n- left side (ports ACE) towards you",
        (Side.FRONT, Side.RIGHT, Side.BACK, Side.LEFT),
    ),
)

hub = ThisHub()
accelerations = [0] * 6
bias = vector(0, 0, 0)


def signal(frequency):
    if hasattr(hub, "speaker"):
        hub.speaker.beep(frequency, 100)
    wait(10)


def rotations():
    return vector(*[hub.imu.rotation(axis, calibrated=False) for axis in (Axis.X, Axis.Y, Axis.Z)])


def roll(axis, side):
    """Wait for the hub to lie on its next side, and measure there. Returns the angle that it was
    rolled by."""
    global bias
    print("Roll it towards you, without lifting the hub up!")
    start = hub.imu.rotation(axis, calibrated=False)
    while not (hub.imu.stationary() and hub.imu.up() == side):
        direction = hub.imu.orientation() * axis
        if abs(direction[2]) > 0.07:
            print(direction)
            raise RuntimeError("Lifted it!")
        wait(100)
    angle = abs(hub.imu.rotation(axis, calibrated=False) - start)
    if not 80 <= angle <= 100:
        raise RuntimeError("Not 90 deg!")
    print("Calibrating...")
    signal(1000)
    before = rotations()
    total = vector(0, 0, 0)
    for _ in range(SAMPLES):
        total += hub.imu.acceleration(calibrated=False)
        bias += hub.imu.angular_velocity(calibrated=False)
        wait(1)
    if abs(rotations() - before) > 1:
        raise RuntimeError("Moved it!")
    place, component = PLACES[side]
    accelerations[place] += total[component] / SAMPLES
    signal(500)
    return angle


scales = []
for axis, name, start, sides in TURNS:
    print(
        "\nGoing to calibrate "
        + name
        + "\n- Put the hub on the table in front of you.\n"
        + start
        + "\n"
    )
    while not (hub.imu.stationary() and hub.imu.up() == sides[0]):
        wait(10)
    signal(500)
    turned = 0
    for _ in range(ROUNDS):
        for side in sides[1:] + sides[:1]:
            turned += roll(axis, side)
    scales.append(turned / ROUNDS)

visits = 2 * ROUNDS  # of each side, about two axes
hub.imu.settings(
    angular_velocity_bias=tuple(bias / (6 * visits * SAMPLES)),
    angular_velocity_scale=tuple(scales),
    acceleration_correction=[total / visits for total in accelerations],
)
print("Result: ", hub.imu.settings())
