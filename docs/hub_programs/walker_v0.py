# A network that learned Walker-v0
# Robot: walker
# Program of the robot "walker" for the prime hub, written by BricksRL from the robot's description.
# Do not edit: it is written anew whenever the description changes.
# Commands, in the order of the action:
#   left_front: turn by -100 to 0 deg at 600 deg/s
#   right_front: turn by -100 to 0 deg at 600 deg/s
#   left_back: turn by -100 to 0 deg at 600 deg/s
#   right_back: turn by -100 to 0 deg at 600 deg/s
# Channels, in the order of the observation:
#   left_front_angle, 0 to 360 deg
#   right_front_angle, 0 to 360 deg
#   left_back_angle, 0 to 360 deg
#   right_back_angle, 0 to 360 deg
#   pitch, -90 to 90 deg
#   roll, -90 to 90 deg
#   distance, 0 to 2000 mm
# It acts by itself, by a network that learned Walker-v0, until the center button is pressed.

from pybricks.hubs import PrimeHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.tools import StopWatch, wait
import umath


UNTIL_DONE = False  # a step ends when all moves have ended
SETTLE_MS = 250  # and after this time in any case
COUNTING = ()  # places of what counts from the start of the acting
AGE_MS = 65  # age of an observation when its commands start
# Middle and half of each command's range, times its scale.
SPANS = ((-500.0, 500.0), (-500.0, 500.0), (-500.0, 500.0), (-500.0, 500.0))


hub = PrimeHub()
motor_left_front = Motor(Port.D, Direction.COUNTERCLOCKWISE)
motor_right_front = Motor(Port.C)
motor_left_back = Motor(Port.B, Direction.COUNTERCLOCKWISE)
motor_right_back = Motor(Port.A)
sensor_eyes = UltrasonicSensor(Port.E)

MOVERS = [motor_left_front, motor_right_front, motor_left_back, motor_right_back]


def start_moves(actions):
    """Start the commands, clamped to their ranges, without waiting for their ends."""
    motor_left_front.run_angle(600, whole(actions[0], -1000, 0, 10), wait=False)
    motor_right_front.run_angle(600, whole(actions[1], -1000, 0, 10), wait=False)
    motor_left_back.run_angle(600, whole(actions[2], -1000, 0, 10), wait=False)
    motor_right_back.run_angle(600, whole(actions[3], -1000, 0, 10), wait=False)


def observe():
    """What the policy observes, each number in its unit."""
    pitch, roll = hub.imu.tilt()
    return [
        motor_left_front.angle() % 360,
        motor_right_front.angle() % 360,
        motor_left_back.angle() % 360,
        motor_right_back.angle() % 360,
        pitch,
        roll,
        sensor_eyes.distance(),
    ]


LINEAR = (  # index, factor and offset of what is no angle; its least and its greatest value
    (4, 0.01111, -0, -7.74, 3.85),
    (5, 0.01111, -0, -8.75, 8.76),
    (6, 0.001, -1, 2000, 2000),
)
ANGLES = ((0, 7), (1, 7), (2, 7), (3, 7), (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))  # indices of two angles, or of one and of a 0 that follows the last
LAYERS = (  # a row for each unit: its weights, then its offset
    (
        (-0.5912, -0.654, 0.04783, -0.1702, -0.3481, 0.3061, -0.1134, 0.2964, 0.4925, -1.618, -0.153, 0.273, -0.01469, -0.171, 0.005312, -0.04037, -0.08043, -0.2471, 0.07311, 0.2628, -0.02609, 0.08384, -0.2429, 0.2573),
        (0.3778, 0.1449, 0.1124, -0.1398, 0.1036, 0.2307, 0.132, -0.4807, -0.01242, -0.1593, -0.6751, 0.4934, 0.5392, -0.004353, -0.23, 0.386, 0.2238, -0.2721, -0.3985, -0.007606, 0.1527, -0.2047, -0.3934, -0.1035),
        (0.03287, -0.2037, -0.2075, 0.1337, 0.01406, -0.03802, -0.1502, -0.04211, 0.2632, -0.2636, 0.1165, 0.09837, -0.1708, -0.08131, 0.06586, -0.003294, -0.07908, 0.1964, -0.003125, -0.304, -0.07517, -0.04288, -0.0122, 0.01911),
        (-0.08293, -0.04248, 0.162, -0.04328, 0.00784, -0.1223, -0.05667, -0.1774, 0.1164, 0.4545, -0.7251, -0.08895, -0.163, 0.06021, 0.1005, 0.2701, 0.285, -0.2307, 0.08853, 0.1424, -0.1762, -0.1043, -0.215, 0.07016),
        (-0.002609, -0.4263, 0.2861, -0.3061, -0.2983, 0.01086, -0.0952, -0.5438, -0.5782, 0.3644, -0.4516, 0.354, 0.6445, 0.2543, 0.277, 0.02602, -0.02852, 0.4598, 0.2198, 0.084, 0.2731, 0.4189, 0.1776, 0.4341),
        (0.02225, 0.2443, 0.0654, 0.06158, -0.0548, -0.0123, -0.017, -0.03851, 0.07724, 0.1887, -0.1801, -0.1231, -0.06851, 0.001698, -0.1057, 0.003036, -0.1996, -0.09062, 0.2125, -0.1472, -0.1632, 0.1861, 0.04917, 0.09108),
        (0.09998, -0.009307, -0.103, 0.04091, 0.1465, -0.1568, -0.006717, 0.06108, 0.01586, 0.1149, 0.007006, -0.1381, 0.05276, 0.001814, -0.05879, -0.03837, -0.06878, -0.107, 0.2322, -0.1999, -0.1686, -0.04662, -0.1376, -0.03074),
        (-0.1086, -0.1066, -0.08848, -0.2094, 0.007151, 0.01679, 0.1683, -0.03311, 0.1529, 0.06968, -0.1494, 0.2227, -0.1755, 0.05888, 0.04069, 0.003718, 0.02826, 0.1501, 0.1557, -0.02746, -0.02938, -0.04881, -0.2016, -0.2259),
        (-0.3026, 0.07224, -0.121, 0.1738, 0.02553, -0.2215, -0.06332, 0.1458, -0.2208, -0.6933, 0.3688, 0.1104, 0.3363, -0.3867, 0.05716, -0.2618, 0.03601, -0.3392, -0.0973, -0.02081, 0.1176, -0.1976, -0.1349, -0.09253),
        (0.03316, 0.2044, 0.1196, 0.213, 0.06222, 0.09888, -0.2426, 0.05529, -0.1565, 0.02635, 1.024, -0.2286, 0.1895, -0.07117, -0.08086, -0.1107, 0.2308, -0.1891, -0.3181, 0.05227, 0.2549, 0.02759, -0.3233, 0.2194),
        (0.123, -0.03521, -0.05483, 0.01913, 0.1729, 0.1304, 0.1513, -0.177, -0.1427, 0.03349, 0.03475, -0.01599, 0.1995, -0.05291, -0.06303, 0.1321, 0.1329, -0.07703, 0.2043, -0.2065, 0.04706, 0.02945, -0.1319, -0.09347),
        (0.09283, -0.2029, -0.1435, 0.002358, 0.1438, 0.01742, -0.09045, 0.05278, -0.1601, -0.1086, -0.05951, 0.09108, 0.1712, -0.1853, -0.1946, -0.009334, 0.1915, 0.01443, 0.03215, -0.1002, -0.04848, 0.09211, -0.1982, -0.03833),
        (-0.1644, 0.4607, -0.08908, -0.1022, 0.2601, 0.2461, -0.09563, -0.3494, -0.06406, 0.2864, -0.1552, -0.2404, -0.3537, -0.2373, -0.1465, 0.297, -0.09271, -0.1931, -0.04584, 0.2025, -0.08204, -0.2512, 0.01097, -0.1412),
        (-0.1267, 0.08119, 0.1472, -0.1394, 0.04263, 0.02591, 0.165, 0.1016, 0.007887, -0.2185, 0.05024, -0.09224, 0.1146, -0.06846, -0.0289, 0.08251, 0.1616, 0.2187, -0.1427, -0.1351, -0.1581, 0.1816, -0.1279, -0.2421),
        (0.04826, 0.1002, -0.1867, 0.1271, -0.1241, -0.1092, 0.1248, -0.03924, 0.2498, 0.131, 0.02105, -0.162, -0.1799, 0.1984, 0.3074, 0.1552, 0.2121, 0.3216, 0.2632, -0.1292, -0.05413, 0.06473, -0.007313, 0.04341),
        (0.1658, 0.2308, 0.1887, -0.06905, -0.03462, 0.06642, -0.01682, -0.2349, -0.2556, 0.1064, -0.06602, -0.1027, -0.1016, 0.05467, 0.2087, 0.09965, 0.3041, 0.2852, 0.2969, 0.08993, -0.1883, -0.04584, 0.2245, 0.005311),
    ),
    (
        (-0.1134, -0.083, -0.1685, 0.1029, -0.2091, -0.007903, 0.03094, -0.1213, 0.01002, -0.1624, -0.0818, 0.2158, -0.1214, 0.1867, 0.2499, 0.02908, -0.09257),
        (0.2563, 0.04364, 0.1595, 0.09392, -0.3416, 0.1945, 0.07237, -0.03444, 0.0118, 0.3541, -0.1242, -0.1636, -0.1053, 0.1721, 0.1755, 0.09714, -0.1312),
        (0.3412, -0.2393, 0.07173, 0.388, -0.2979, 0.2221, 0.09505, 0.1176, -0.1959, 0.1079, -0.1179, -0.02462, 0.08196, 0.1755, -0.3113, -0.06454, 0.2767),
        (-0.01139, -0.07533, 0.007879, -0.1294, -0.1626, -0.1278, 0.1626, 0.06334, -0.1364, -0.2471, -0.1645, -0.09242, -0.06163, -0.2818, 0.07361, -0.1148, 0.1713),
        (-0.1814, 0.01351, 0.1512, -0.1254, -0.2444, -0.04362, 0.04802, -0.1898, 0.1549, 0.2212, -0.1388, -0.008217, 0.3547, -0.2019, 0.09359, 0.1329, -0.04049),
        (0.3805, 0.3587, -0.1367, 0.07163, -0.7364, -0.004881, -0.03612, -0.007914, -0.04818, 0.08178, -0.04768, 0.1331, 0.0972, -0.1064, -0.1362, 0.1747, 0.08296),
        (-0.2392, 0.4132, -0.1069, 0.35, -0.4686, -0.1945, 0.1255, 0.1273, 0.2165, 0.09773, 0.01818, 0.156, 0.3548, -0.1559, 0.08751, -0.06808, 0.02483),
        (-0.1179, -0.09066, -0.1972, 0.1822, 0.5518, -0.03038, 0.04345, -0.03502, 0.05301, -0.1689, -0.2097, -0.1152, -0.2406, -0.1053, 0.4513, 0.4084, 0.009668),
        (0.1999, 0.1615, 0.04578, -0.3246, 0.1475, -0.1189, -0.09544, -0.01395, 0.4169, 0.1084, 0.004291, -0.1901, -0.06627, -0.05826, 0.221, 0.3689, -0.2041),
        (-0.2279, -0.02932, -0.2132, -0.2512, -0.1432, 0.1509, -0.06335, 0.156, -0.2196, 0.06659, -0.05666, 0.028, 0.1439, -0.1867, -0.1165, -0.0563, -0.2813),
        (-0.303, 0.3288, -0.135, -0.0935, 0.4008, 0.1449, -0.2205, 0.1062, -0.1056, -0.04541, -0.1556, 0.2329, 0.1783, -0.1464, 0.5786, 0.03243, -0.2137),
        (-0.0597, -0.1439, -0.06521, 0.1863, -0.002157, -0.1376, 0.03741, -0.02802, 0.2991, 0.2526, 0.05537, -0.1222, 0.1255, 0.2194, 0.1838, 0.3087, 0.04794),
        (0.1685, -0.1262, -0.1544, -0.03824, -0.4994, -0.1752, 0.1917, -0.09027, 0.2475, 0.2165, 0.23, -0.00704, 0.01365, 0.02258, -0.2092, -0.2648, 0.2068),
        (-0.132, -0.06536, -0.2971, 0.1607, 0.03497, -0.01674, -0.06361, -0.209, 0.0364, -0.3361, -0.1748, 0.1027, 0.116, 0.18, -0.09166, -0.2172, 0.04534),
        (-0.2557, 0.0407, -0.1042, 0.03818, 0.4612, -0.0897, 0.05046, 0.1647, -0.05622, 0.06578, -0.1134, 0.08289, -0.369, 0.1762, 0.1077, 0.1268, 0.06891),
        (-0.08394, 0.439, -0.07885, 0.03374, 0.2746, 0.02152, -0.1205, 0.2511, 0.003118, 0.05873, -0.1411, 0.1149, -0.1214, 0.102, 0.3078, 0.2994, -0.009138),
    ),
    (
        (0.07191, -0.1044, 0.2401, 0.01662, -0.2609, 0.06699, -0.4065, -0.3492, 0.06863, 0.1005, 0.5594, -0.1871, 0.2677, 0.12, 0.05285, -0.3305, -0.2918),
        (0.05543, -0.3501, -0.1741, 0.05504, -0.2791, 0.02249, -0.08251, 0.225, 0.165, 0.1719, -0.09897, -0.3475, -0.3813, -0.1557, 0.1065, 0.04822, 0.06148),
        (-0.1417, -0.2389, -0.2456, -0.134, 0.2445, -0.1775, -0.1757, 0.2596, 0.3393, 0.124, 0.277, 0.2339, -0.08469, 0.1306, -0.1105, -0.129, -0.3131),
        (-0.222, -0.04067, 0.1891, -0.08597, 0.05914, -0.3419, -0.1402, -0.1204, -0.3396, -0.2294, 0.2457, -0.1653, 0.01155, 0.179, 0.004092, -0.3448, 0.03438),
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
