# A network that learned Spinning-v0
# Robot: two-wheeler
# Program of the robot "two-wheeler" for the prime hub, written by BricksRL from the robot's description.
# Do not edit: it is written anew whenever the description changes.
# Commands, in the order of the action:
#   left: turn by -100 to 100 deg at 400 deg/s
#   right: turn by -100 to 100 deg at 400 deg/s
# Channels, in the order of the observation:
#   left_angle, 0 to 360 deg
#   right_angle, 0 to 360 deg
#   pitch, -90 to 90 deg
#   roll, -90 to 90 deg
#   yaw_rate, -100 to 100 deg/s
# It acts by itself, by a network that learned Spinning-v0, until the center button is pressed.

from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Direction, Port
from pybricks.pupdevices import Motor
from pybricks.tools import StopWatch, wait
import umath
from urandom import randint, uniform


UNTIL_DONE = False  # a step ends when all moves have ended
SETTLE_MS = 100  # and after this time in any case
COUNTING = ()  # places of what counts from the start of the acting
AGE_MS = 80  # age of an observation when its commands start
# Middle and half of each command's range, times its scale.
SPANS = ((0.0, 1000.0), (0.0, 1000.0))


hub = PrimeHub()
motor_left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
motor_right = Motor(Port.A)

MOVERS = [motor_left, motor_right]


def start_moves(actions):
    """Start the commands, clamped to their ranges, without waiting for their ends."""
    motor_left.run_angle(400, whole(actions[0], -1000, 1000, 10), wait=False)
    motor_right.run_angle(400, whole(actions[1], -1000, 1000, 10), wait=False)


GOALS = ((0, 1),)  # lowest and highest value; whole numbers if both are
GOAL_STEPS = 50  # steps after which they are drawn anew


drawn = []
steps = 0


def goals():
    """The goals of this step."""
    global drawn, steps
    if steps % GOAL_STEPS == 0:
        drawn = [
            randint(low, high) if isinstance(low, int) else uniform(low, high)
            for low, high in GOALS
        ]
    steps += 1
    return drawn


def observe():
    """What the policy observes, each number in its unit."""
    pitch, roll = hub.imu.tilt()
    return [
        motor_left.angle() % 360,
        motor_right.angle() % 360,
        pitch,
        roll,
        hub.imu.angular_velocity(Axis.Z),
    ] + goals()


LINEAR = (  # index, factor and offset of what is no angle; its least and its greatest value
    (2, 0.01111, -0, -1.01, 1.07),
    (3, 0.01111, -0, -0.96, 1.21),
    (4, 0.01, -0, -187.7, 187.1),
    (5, 2, -1, 0, 1),
)
ANGLES = ((0, 6), (1, 6), (0, 1))  # indices of two angles, or of one and of a 0 that follows the last
LAYERS = (  # a row for each unit: its weights, then its offset
    (
        (0.3771, 0.5639, -0.1417, 0.4702, -0.2125, 0.02004, 0.1659, -0.03242, -0.2733, -0.2429, -0.05066),
        (0.7644, -0.1571, -0.2578, 0.06208, -0.3153, -0.4809, 0.05834, -0.08393, 0.3392, 0.5109, -0.1529),
        (0.03843, 0.3243, -0.259, -0.08696, -0.2143, 0.2939, 0.1382, -0.3781, 0.2252, -0.1472, -0.1728),
        (-0.08476, 0.07161, 0.3047, -0.2791, 0.1826, 0.2155, -0.001433, 0.2168, 0.1592, -0.363, 0.1242),
        (-0.1806, -0.4622, 0.08157, 0.5014, 0.2005, -0.2014, 0.0399, 0.03778, -0.04822, 0.1443, 0.03514),
        (-0.0005143, -0.1029, -0.3684, -0.09871, 0.3376, -0.03161, 0.099, 0.03819, -0.429, 0.06169, -0.01196),
        (0.899, 1.383, -0.1096, 0.05645, 0.66, -0.1675, -0.3262, -0.03779, 0.07547, -0.3677, -0.05905),
        (-0.2138, -0.1982, -0.0819, 0.3118, -0.1137, -0.0007606, 0.1154, 0.1044, -0.03786, -0.06492, 0.2849),
        (0.2756, -0.1836, 0.2855, -0.2543, 0.06797, 0.139, -0.1637, 0.004302, -0.1032, 0.1203, 0.2004),
        (0.2716, 0.1549, -0.1474, 0.237, 0.03095, 0.03415, -0.1792, 0.1801, 0.2303, 0.03617, 0.4915),
        (0.07021, 0.1118, -0.4815, -0.622, -0.001938, -0.04862, 0.03081, -0.007524, 0.02092, 0.1207, 0.2842),
        (0.2827, 0.3967, 0.05978, -0.4056, 0.1879, 0.00524, 0.3396, 0.2736, 0.2528, -0.008922, -0.2083),
        (0.2073, -0.2089, 0.17, 0.2823, 0.2034, -0.001876, -0.3254, -0.03788, 0.03113, 0.1118, 0.4598),
        (0.1736, -0.2569, -0.2334, 0.4294, -0.1246, -0.1884, 0.3836, -0.1506, 0.3905, -0.05755, -0.1201),
        (-0.09824, 0.04229, 0.1601, -0.4258, 0.1023, -0.03298, 0.06628, 0.03863, -0.04249, 0.1974, 0.2881),
        (-0.3073, 0.5935, -0.2274, 0.05034, 0.05347, -0.09309, 0.5988, -0.3192, -0.1886, -0.09111, 0.2642),
    ),
    (
        (0.015, 0.1088, 0.1355, 0.2446, -0.1868, 0.1563, -0.09661, -0.21, 0.2198, -0.2339, 0.006904, -0.03503, 0.07405, -0.3874, 0.2225, 0.1711, 0.2374),
        (0.0928, 0.4238, 0.1516, -0.03007, -0.0862, 0.09734, 0.1226, -0.1564, 0.2898, -0.2167, 0.2993, -0.1776, 0.1365, 0.3046, 0.1465, 0.3457, 0.09584),
        (0.04987, 0.1699, 0.2164, -0.182, 0.1608, 0.006385, -0.1341, -0.02754, -0.1643, 0.3296, -0.4572, 0.3147, 0.2581, -0.01972, -0.2422, 0.2597, 0.1755),
        (0.0535, 0.05247, 0.1534, 0.289, 0.2604, -0.1368, 0.19, 0.09689, -0.07256, 0.1395, 1.003, 0.07587, -0.1837, -0.1099, -0.03222, 0.06202, -0.05271),
        (-0.00388, -0.04904, 0.1986, -0.09499, -0.1054, 0.1096, 0.1114, -0.1408, 0.2085, -0.2887, 0.01896, -0.01293, -0.205, 0.06352, -0.2433, -0.221, -0.0577),
        (0.138, 0.1994, 0.07179, -0.311, 0.1877, -0.1164, -0.06093, 0.0729, 0.01124, 0.3335, -0.6681, -0.09979, 0.2325, 0.2695, -0.2134, 0.1744, 0.112),
        (0.01874, -0.01315, 0.2022, -0.4263, 0.1826, 0.3405, -0.05971, 0.07199, -0.2015, 0.2664, -0.3477, -0.02366, 0.1907, -0.07084, -0.08647, 0.04477, 0.223),
        (-0.1956, -0.1282, -0.2852, 0.4419, -0.1684, -0.1515, -0.1265, 0.1805, -0.1053, -0.3719, -0.04461, -0.1711, 0.2834, 0.2622, -0.2582, 0.1939, 0.1497),
        (0.2298, 0.1902, 0.08471, -0.1472, -0.06666, 0.05473, -0.1401, 0.209, -0.1287, 0.1965, -0.09919, 0.4415, 0.3938, -0.1819, -0.2657, 0.04954, 0.1007),
        (0.1491, -0.222, -0.08111, 0.03964, -0.181, 0.1808, -0.2422, -0.2133, 0.1406, -0.1944, 0.1503, -0.002239, -0.04021, -0.04942, -0.08131, 0.05626, -0.2152),
        (0.1016, -0.0277, 0.09561, 0.3322, -0.06555, -0.08038, 0.1197, -0.3322, -0.0819, 0.04781, 0.7105, 0.2172, -0.01707, -0.2174, 0.2931, -0.01227, 0.007008),
        (-0.2672, -0.2668, 0.1117, -0.1369, -0.2676, -0.2657, -0.1072, 0.0238, -0.1002, 0.1789, 0.1136, 0.1318, 0.04932, -0.2866, -0.1737, 0.04799, -0.1542),
        (0.1595, -0.2819, 0.1744, 0.06546, 0.1121, 0.0706, -0.001458, -0.3189, -0.2558, 0.09154, -0.1349, -0.03829, -0.3214, -0.222, 0.03079, -0.1471, -0.05291),
        (0.07054, 0.2933, 0.01648, 0.225, -0.2239, 0.1479, 0.2475, 0.03456, 0.05012, 0.01236, 0.3019, 0.2939, -0.1929, 0.3063, 0.3555, 0.1744, -0.1285),
        (0.3716, 0.05984, 0.1022, -0.1825, 0.136, 0.2468, 0.1219, 0.06125, -0.1886, 0.3683, -0.3993, -0.05694, -0.04796, 0.2583, -0.006532, 0.304, 0.1805),
        (-0.01323, 0.1269, 0.1695, 0.08136, 0.1914, 0.1156, 0.2789, 0.2535, -0.2824, 0.08512, 0.08128, 0.6117, 0.233, 0.2854, -0.3479, 0.3331, 0.1795),
    ),
    (
        (-0.1573, 0.01387, 0.2115, -0.2055, -0.0387, 0.1285, 0.0615, -0.2508, 0.2182, 0.03923, -0.2996, 0.04709, 0.1802, -0.373, 0.2198, 0.3642, -0.1326),
        (0.4032, 0.2444, -0.3434, -0.1255, 0.1289, -0.1727, -0.2055, -0.179, -0.212, 0.08809, 0.1268, 0.07804, 0.05927, 0.02224, -0.3454, 0.01544, 0.1702),
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
