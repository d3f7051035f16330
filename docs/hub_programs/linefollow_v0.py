# A network that learned LineFollow-v0
# Robot: scout linefollow_v0
# Program of the robot "scout" for the prime hub, written by BricksRL from the robot's description.
# Do not edit: it is written anew whenever the description changes.
# Commands, in the order of the action:
#   drive_speed: drive at 40 to 100 mm/s
#   turn_rate: turn at -45 to 45 deg/s
# Channels, in the order of the observation:
#   light_reflection, 0 to 100 %
#   yaw_rate, -100 to 100 deg/s
# It acts by itself, by a network that learned LineFollow-v0, until the center button is pressed.

from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Direction, Port
from pybricks.pupdevices import ColorSensor, Motor
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait
import umath


UNTIL_DONE = False  # a step ends when all moves have ended
SETTLE_MS = 60  # and after this time in any case
COUNTING = ()  # places of what counts from the start of the acting
AGE_MS = 30  # age of an observation when its commands start
# Middle and half of each command's range, times its scale.
SPANS = ((700.0, 300.0), (0.0, 450.0))


hub = PrimeHub()
motor_left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
motor_right = Motor(Port.A)
drive_base = DriveBase(motor_left, motor_right, wheel_diameter=56, axle_track=130)
sensor_light = ColorSensor(Port.B)

MOVERS = [drive_base]


def start_moves(actions):
    """Start the commands, clamped to their ranges, without waiting for their ends."""
    drive_base.drive(whole(actions[0], 400, 1000, 10), whole(actions[1], -450, 450, 10))


def observe():
    """What the policy observes, each number in its unit."""
    return [
        sensor_light.reflection(),
        hub.imu.angular_velocity(Axis.Z),
    ]


LINEAR = (  # index, factor and offset of what is no angle; its least and its greatest value
    (0, 0.02, -1, 4, 75),
    (1, 0.01, -0, -50.7, 42.1),
)
ANGLES = ()  # indices of two angles, or of one and of a 0 that follows the last
LAYERS = (  # a row for each unit: its weights, then its offset
    (
        (-0.6357, 1.177, 0.1745),
        (0.03921, 1.278, 0.003436),
        (-1.333, -0.3653, -0.1565),
        (0.6947, -0.4878, 0.6763),
        (-0.9019, -0.4912, -0.6396),
        (-0.5708, 0.7835, 0.475),
        (-0.06503, -0.02659, 0.4894),
        (-0.8771, -0.7142, -0.6467),
        (-0.9957, -0.8193, 0.03153),
        (0.5901, 0.6019, -0.5451),
        (-0.984, 0.6107, -0.1104),
        (-0.7312, -1.049, 0.1864),
        (0.3215, 0.9326, 0.1889),
        (-0.1439, -0.4796, -0.5926),
        (0.08295, 0.3889, -0.275),
        (-1.168, 1.21, -0.1808),
    ),
    (
        (0.1488, -0.285, -0.458, 0.1851, -0.2291, -0.05143, 0.3284, -0.1846, -0.6369, 0.1532, -0.1611, -0.2539, 0.5467, 0.132, -0.23, 0.1189, 0.2825),
        (-0.5552, 1.079, 0.05657, 0.1457, -0.1472, -0.3147, -0.3034, 0.2411, -0.6978, 0.1302, -0.2602, 0.05909, 0.3432, 0.1644, -0.2117, 0.7484, 0.1087),
        (0.2941, 0.001147, 0.2671, -0.01097, -0.7028, 0.2536, -0.2033, 0.1223, -0.2138, -0.1807, 0.551, -0.2848, 0.2195, 0.03607, -0.04272, -0.9186, 0.2271),
        (0.05136, 0.1504, 0.2192, 0.1684, -0.8075, 0.09672, -0.02099, -0.8231, 0.005972, 0.02997, 0.5318, -0.02078, 0.3308, 0.07901, -0.01251, -0.9526, 0.2632),
        (-0.08461, 0.1277, -0.1622, -0.1025, 0.2158, 0.1029, 0.01579, -0.1025, -0.08961, -0.01694, -0.01367, 0.1204, 0.1355, -0.1489, -0.224, -0.1988, -0.2416),
        (0.2596, -0.1184, 0.6396, -0.6284, -0.7601, 0.3172, -0.08258, -0.3383, 0.193, -0.0137, 0.6552, -0.06361, 0.4485, -0.04584, 0.1192, -1.331, -0.065),
        (0.3773, 0.09651, -0.5162, 0.3219, 0.06165, -0.1401, 0.1057, -0.01014, -0.3526, -0.08185, 0.7032, -0.4678, 0.8159, -0.1847, -0.1471, -0.7159, -0.008753),
        (0.1366, -0.01371, -0.2421, 0.2574, -0.2083, -1.409, -0.3687, 0.2424, -0.8307, 0.222, -0.3452, -1.115, 1.054, -0.25, 0.1362, -0.547, 0.1468),
        (-0.3423, 0.9843, -0.4142, 0.5437, 0.03204, -0.4012, -0.05841, -0.2442, -0.4137, -0.1885, -0.4103, -0.0523, 0.317, -0.2345, 0.01016, 0.97, -0.00317),
        (-0.2419, 0.5952, -0.9519, 0.6604, -0.1266, -0.3728, 0.08327, -0.1158, -0.08565, -0.2485, -0.6993, 0.08996, 0.4123, -0.09278, -0.04268, 1.294, 0.3171),
        (0.08283, -0.3721, -0.3392, 0.1777, 0.02583, -0.06662, -0.157, -0.1752, -0.5726, 0.1778, -0.08956, 0.1699, 0.2066, -0.0907, -0.08237, 0.325, 0.2804),
        (0.2311, -0.4844, -0.6255, 0.373, 0.1844, -0.2497, 0.1971, -0.04222, -0.6193, 0.02294, 0.1562, 0.1136, 0.2163, -0.2122, -0.1711, 0.3721, 0.2346),
        (0.1174, -0.2524, 0.9703, -0.3968, 1.247, 0.2494, 0.1115, 1.103, 0.7688, -0.2476, 0.6382, -0.0422, -0.5193, 0.04131, -0.2433, -0.63, 0.05752),
        (0.002827, 0.1725, 0.02088, -0.1084, 0.06328, -0.192, -0.1302, -0.07135, 0.1092, 0.2053, -0.2222, -0.2333, -0.01119, 0.2296, 0.0173, 0.03855, -0.2398),
        (-0.1201, -0.05813, 0.1104, -0.2376, 0.05498, 0.2239, -0.1684, -0.06013, 0.01919, 0.1323, 0.1091, -0.1488, 0.07106, -0.136, 0.1241, -0.08866, -0.09342),
        (0.00417, -0.506, -0.2423, 0.4911, -0.2331, 0.1173, 0.1982, 0.1589, -0.7641, -0.1874, 0.1789, -0.2352, 0.835, 0.245, -0.2362, -0.03679, 0.1719),
    ),
    (
        (0.6091, 0.03564, 0.6768, 0.4281, -0.1402, 1.065, -1.075, -1.731, 1.405, -1.197, 0.3245, 0.1291, 0.06717, -0.04942, -0.04169, 0.9481, -0.2255),
        (0.1789, -1.169, 0.117, 0.5911, 0.1185, -0.219, 0.3965, 1.157, 0.05646, 0.1035, 0.2936, 0.3687, -0.3635, 0.007663, 0.1318, -0.3301, -0.07805),
    ),
)



def features(observed):
    values = observed + [0]
    angles = [umath.radians(values[plus] - values[minus]) for plus, minus in ANGLES]
    scaled = [max(least, min(most, values[index])) * scale + offset for index, scale, offset, least, most in LINEAR]
    return scaled + [umath.sin(angle) for angle in angles] + [umath.cos(angle) for angle in angles]


def outputs(layer, values):
    result = []
    for row in layer:
        total = row[-1]
        for index in range(len(values)):
            total += row[index] * values[index]
        result.append(total)
    return result


def act(observed):
    """The network: layers of rectified units, and a linear one."""
    values = features(observed)
    for layer in LAYERS[:-1]:
        values = [max(0.0, value) for value in outputs(layer, values)]
    return [max(-1.0, min(1.0, value)) for value in outputs(LAYERS[-1], values)]


LOOK_MS = 5  # between two looks at motors, whose moves end in a control loop of 5 ms


def whole(value, low, high, scale):
    """Clamp a wire value to its range; in whole degrees or millimetres, as the motors take them."""
    return (max(low, min(high, value)) + scale // 2) // scale


def stop_motors():
    for mover in MOVERS:
        try:
            mover.stop()
        except OSError:
            pass  # unplugged; go on with the others


def relative(observed, first):
    """What a policy reads: the observation, with what counts on since the first one."""
    if not COUNTING:
        return observed
    read = list(observed)
    for place in COUNTING:
        read[place] -= first[place]
    return read


CLOCK = StopWatch()
COMMANDED = [0] * len(SPANS)  # the last commands, times their scales


def settle(started_ms):
    """Wait for the end of a step. A move that is still blocked then is stopped."""
    left_ms = SETTLE_MS
    while left_ms > 0 and not (UNTIL_DONE and all(mover.done() for mover in MOVERS)):
        wait(min(LOOK_MS, left_ms))
        left_ms = started_ms + SETTLE_MS - CLOCK.time()
    if UNTIL_DONE:
        for mover in MOVERS:
            if not mover.done():
                mover.stop()


def live():
    """Observe, act and wait, step by step."""
    first = None
    try:
        while True:
            observed = observe()
            if first is None:
                first = observed
            observed = relative(observed, first)
            seen_ms = CLOCK.time()
            commands = [
                round(middle + half * action)
                for (middle, half), action in zip(SPANS, act(observed))
            ]
            COMMANDED[:] = commands
            computed_ms = CLOCK.time() - seen_ms
            wait(max(0, AGE_MS - computed_ms))
            started_ms = CLOCK.time()
            start_moves(commands)
            print(computed_ms, *observed, *commands)
            settle(started_ms)
    finally:
        stop_motors()


live()
