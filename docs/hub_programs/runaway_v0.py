# A network that learned RunAway-v0
# Robot: two-wheeler runaway_v0
# Program of the robot "two-wheeler" for the prime hub, written by BricksRL from the robot's description.
# Do not edit: it is written anew whenever the description changes.
# Commands, in the order of the action:
#   straight: drive -100 to 100 mm
# Channels, in the order of the observation:
#   left_angle, 0 to 360 deg
#   right_angle, 0 to 360 deg
#   pitch, -90 to 90 deg
#   roll, -90 to 90 deg
#   distance, 0 to 2000 mm
# It acts by itself, by a network that learned RunAway-v0, until the center button is pressed.

from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait
import umath


UNTIL_DONE = True  # a step ends when all moves have ended
SETTLE_MS = 3000  # and after this time in any case
COUNTING = ()  # places of what counts from the start of the acting
AGE_MS = 0  # age of an observation when its commands start
# Middle and half of each command's range, times its scale.
SPANS = ((0.0, 1000.0),)


hub = PrimeHub()
motor_left = Motor(Port.E, Direction.COUNTERCLOCKWISE)
motor_right = Motor(Port.A)
drive_base = DriveBase(motor_left, motor_right, wheel_diameter=56, axle_track=130)
sensor_eyes = UltrasonicSensor(Port.C)

MOVERS = [drive_base]


def start_moves(actions):
    """Start the commands, clamped to their ranges, without waiting for their ends."""
    drive_base.straight(whole(actions[0], -1000, 1000, 10), wait=False)


def observe():
    """What the policy observes, each number in its unit."""
    pitch, roll = hub.imu.tilt()
    return [
        motor_left.angle() % 360,
        motor_right.angle() % 360,
        pitch,
        roll,
        sensor_eyes.distance(),
    ]


LINEAR = (  # index, factor and offset of what is no angle; its least and its greatest value
    (2, 0.01111, -0, -0.94, 1.03),
    (3, 0.01111, -0, -1.04, 1.08),
    (4, 0.001, -1, 199, 1775),
)
ANGLES = ((0, 5), (1, 5), (0, 1))  # indices of two angles, or of one and of a 0 that follows the last
LAYERS = (  # a row for each unit: its weights, then its offset
    (
        (-0.1573, 0.162, -0.05165, 0.2593, -0.2813, 0.1244, 0.1596, -0.3206, -0.3078, 0.06475),
        (-0.3306, -0.06324, -0.2714, -0.1894, -0.0635, 0.06914, -0.3946, -0.1766, -0.2485, 0.03734),
        (0.1168, 0.1811, 0.05956, 0.4303, -0.0673, -0.1184, 0.1402, 0.215, -0.01293, 0.06884),
        (-0.1972, -0.06889, 0.1092, -0.1662, 0.3116, 0.231, -0.1024, -0.1779, 0.2547, 0.228),
        (0.01192, -0.01695, 0.07283, -0.299, -0.1057, -0.227, 0.09915, 0.3423, 0.02364, 0.08113),
        (-0.1917, -0.0995, -0.1024, -0.1134, 0.1787, 0.06129, 0.02844, -0.2636, -0.2713, -0.1776),
        (0.06083, 0.2277, -0.2845, 0.1654, -0.3279, -0.1598, 0.3763, 0.2648, -0.213, 0.2595),
        (0.1128, -0.2828, -0.423, -0.001703, -0.3033, -0.1962, -0.2503, -0.03605, 0.05585, -0.2791),
        (-0.119, 0.09908, -0.3895, -0.2338, 0.1988, 0.2193, -0.1812, -0.03704, 0.008716, -0.2462),
        (0.05397, -0.05797, -0.06541, 0.093, 0.4832, -0.1303, 0.193, 0.2467, -0.2076, -0.07573),
        (-0.006027, -0.1012, -0.1243, 0.1885, 0.08342, -0.7387, -0.3666, -0.15, 0.3223, -0.01858),
        (0.4655, -0.3352, -0.3153, -0.2715, -0.333, 0.3084, 0.1276, 0.115, -0.07485, -0.1635),
        (0.1112, 0.3489, -0.4828, -0.3157, -0.07288, 0.07182, -0.227, -0.1394, 0.1897, 0.2),
        (0.232, 0.1569, -0.06744, -0.02796, 0.007279, 0.04086, 0.1644, 0.159, -0.2605, -0.3081),
        (-0.3482, -0.2384, 0.05579, -0.2232, -0.04873, -0.2181, -0.2103, 0.2742, -0.1836, -0.2416),
        (-0.1637, 0.2007, -0.01827, 0.09639, -0.06041, -0.09139, 0.1415, 0.159, -0.3264, -0.1477),
    ),
    (
        (-0.2198, -0.2551, -0.1654, -0.1219, -0.2724, -0.06842, -0.06795, 0.1639, -0.07611, 0.222, -0.03756, -0.2211, 0.1516, -0.25, 0.1011, 0.0523, -0.1767),
        (0.006407, 0.07955, 0.179, 0.1462, -0.004299, 0.02972, -0.06047, -0.2442, 0.07246, -0.1885, -0.2489, -0.01712, -0.01887, -0.2345, 0.01016, 0.09749, -0.1608),
        (0.05219, -0.07327, -0.1335, -0.0281, -0.184, -0.1765, -0.08052, -0.2742, 0.1412, -0.3133, -0.06366, -0.1704, 0.003234, -0.1446, -0.08079, 0.2445, 0.03107),
        (-0.09034, 0.0858, 0.2183, 0.115, 0.0894, -0.05608, -0.1307, -0.08029, 0.1467, 0.1955, 0.0368, 0.2194, 0.1009, -0.03217, -0.04081, 0.1782, 0.287),
        (-0.06106, -0.2469, -0.01376, 0.2969, 0.2347, -0.2094, 0.2354, 0.04955, 0.1132, 0.02928, 0.2766, 0.1927, 0.252, -0.1482, -0.1262, 0.04015, 0.1993),
        (0.04167, -0.0007817, 0.2707, 0.02388, -0.01019, 0.1968, 0.2569, 0.003596, 0.381, -0.2305, 0.1394, 0.08507, -0.07555, 0.1694, -0.1991, -0.1721, 0.3464),
        (0.002827, 0.1318, -0.1044, -0.1809, -0.01131, -0.192, -0.2323, -0.1199, 0.06779, 0.09092, -0.2766, -0.2873, -0.07196, 0.174, -0.02249, 0.03855, 0.04091),
        (-0.1201, -0.1368, -0.02595, -0.3275, -0.03264, 0.186, -0.2774, -0.1393, -0.05658, 0.01046, 0.021, -0.2358, -0.009168, -0.1911, 0.08374, -0.08866, 0.1062),
        (-0.1915, -0.1878, -0.2409, 0.2545, -0.18, -0.06361, 0.1462, 0.2543, -0.03649, -0.2038, 0.1925, -0.172, 0.2479, 0.2993, -0.1947, 0.1208, 0.09049),
        (0.1008, 0.1651, 0.09796, 0.1582, -0.1966, 0.02941, -0.05752, 0.1645, -0.03105, 0.0767, 0.2567, 0.2049, 0.2818, -0.2398, -0.04829, -0.121, 0.006885),
        (0.1491, -0.222, -0.08111, 0.05079, -0.181, 0.1808, -0.2422, -0.2421, 0.1807, -0.1544, 0.1214, -0.002239, -0.02861, -0.04942, -0.04169, 0.05626, -0.1468),
        (0.09592, -0.06543, 0.09034, 0.3314, 0.2311, -0.1122, 0.07082, 0.03154, -0.01412, 0.1157, 0.3157, 0.2713, -0.05713, 0.04988, 0.1733, -0.07335, 0.08763),
        (-0.2059, -0.3567, 0.1444, -0.09636, -0.3529, -0.2426, -0.1943, 0.02006, 0.05834, 0.1949, 0.1394, 0.06366, 0.02578, -0.2786, -0.2627, 0.09942, 0.1132),
        (0.2125, -0.1763, 0.1981, 0.2175, 0.2055, 0.1821, 0.1185, -0.1117, 0.02308, 0.2153, -0.03905, 0.009675, -0.151, -0.1648, 0.1376, 0.002588, 0.3313),
        (-0.1134, -0.083, -0.1685, 0.1029, -0.2091, -0.007903, 0.03094, -0.1213, 0.01002, -0.1624, -0.0818, 0.2158, -0.1214, 0.1867, 0.2499, 0.02908, -0.1367),
        (0.2332, -0.1362, 0.08801, 0.05729, 0.03909, 0.1416, 0.1068, 0.01196, 0.2499, 0.2294, -0.07706, -0.1517, -0.1297, 0.2359, 0.1785, 0.182, 0.2277),
    ),
    (
        (-0.01452, 0.01155, 0.003218, -0.1536, -0.1035, -0.1896, 0.1258, 0.0481, -0.1736, -0.2566, -0.1374, -0.1596, -0.07776, -0.3333, 0.1414, -0.1053, -0.1487),
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
