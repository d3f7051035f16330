# A network that learned Walker-v1
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
# It acts by itself, by a network that learned Walker-v1, until the center button is pressed.

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
    (4, 0.01111, -0, -6.89, 3.69),
    (5, 0.01111, -0, -8.13, 8.87),
    (6, 0.001, -1, 2000, 2000),
)
ANGLES = ((0, 7), (1, 7), (2, 7), (3, 7), (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))  # indices of two angles, or of one and of a 0 that follows the last
LAYERS = (  # a row for each unit: its weights, then its offset
    (
        (0.1771, 1.256, 0.02361, 0.2033, 0.2287, 0.2933, 0.1852, 0.1416, -0.09942, 0.01584, -0.3711, -0.07498, -0.6424, 0.3078, -0.1654, -0.3256, 0.09749, -0.2418, -0.1658, 0.3724, 0.03539, 0.07384, -0.2367, 0.2331),
        (-2.112, 0.9829, -0.003407, -0.6434, -0.2264, 0.4531, -0.1604, -0.1289, 0.1696, 0.03954, -0.1325, -0.03471, 0.3422, -0.2488, 0.3473, 0.482, -0.1398, 0.03198, 0.03018, -0.007235, 0.07832, 0.03596, -0.04092, -0.2193),
        (-0.008681, -0.1578, -0.1686, 0.1536, -0.02853, -0.02173, -0.2204, -0.2027, 0.254, -0.224, -0.06767, 0.1956, -0.1225, -0.1201, 0.1063, 0.03954, -0.1196, 0.157, -0.04458, -0.2657, -0.03616, -0.08157, -0.05357, 0.05803),
        (-1.127, 0.7718, 0.1923, -0.1506, 0.07727, 0.1981, -0.2608, 0.1378, 0.01757, -0.1674, -0.05387, 0.0344, 0.356, 0.5169, -0.01478, 0.1425, 0.7931, -0.4155, 0.09444, 0.3544, -0.1138, -0.2431, -0.3836, 0.1004),
        (1.607, -0.245, 0.0373, 0.2308, -0.2753, -0.3882, 0.3552, 0.4636, 0.2888, -0.3137, -0.3217, 0.06065, 0.2299, -0.07775, 0.3602, -0.0847, 0.1582, 0.1822, -0.2489, 0.164, 0.2861, -0.009697, -0.07617, 0.1853),
        (0.02761, 0.1401, 0.04322, 0.124, -0.1557, -0.07116, -0.01443, -0.01094, 0.2251, 0.05144, -0.1995, -0.1031, -0.09028, 0.09178, -0.1935, -0.09091, -0.08094, -0.06653, 0.2348, -0.1606, -0.1891, 0.2071, 0.06919, 0.0689),
        (0.5253, 0.04154, -0.2155, 0.04346, 0.1442, -0.5371, 0.3356, -0.1463, 0.07088, 0.2317, -0.2559, 0.00661, 0.3648, -0.2867, -0.09056, -0.1207, 0.09612, -0.04687, 0.2218, -0.04678, -0.2358, -0.1928, -0.2605, -0.1432),
        (-0.1372, -0.1059, -0.08412, -0.1737, -0.02566, -0.0165, 0.2022, -0.001196, 0.1852, 0.03856, -0.1188, 0.1905, -0.2085, 0.0639, -0.006114, -0.04439, 0.03366, 0.09958, 0.1044, -0.02301, -0.02495, -0.1002, -0.2534, -0.2215),
        (-0.9637, 0.6806, -0.1596, 0.007496, -0.3035, -0.1065, 0.1184, 0.5866, -0.09295, -0.2503, 0.1931, 0.1457, 0.4456, -0.1278, -0.00175, -0.0166, -0.1804, -0.3991, -0.2823, 0.1924, 0.2642, -0.1545, 0.005256, -0.1311),
        (1.42, 0.4443, 0.1184, 0.1221, -0.6453, -0.04183, 0.283, -0.03479, -0.2425, 0.09812, 0.2777, -0.1682, 0.0004687, 0.3507, -0.258, -0.1243, -0.1281, 0.00442, -0.2875, 0.05094, 0.3239, 0.09236, -0.2242, 0.2182),
        (-0.9892, -0.1244, -0.0007692, 0.0486, 0.0735, 0.2268, 0.5898, 0.3666, -0.06455, 0.09642, -0.09758, -0.1549, -0.00224, -0.1102, 0.07426, 0.5528, -0.1204, -0.112, -0.0336, 0.05827, 0.1495, -0.3015, -0.2752, -0.0394),
        (0.0631, -0.2326, -0.1734, -0.0275, 0.114, -0.01244, -0.06059, 0.08264, -0.1303, -0.1385, -0.08937, 0.1209, 0.2011, -0.2152, -0.1647, 0.02053, 0.1616, 0.04429, 0.06201, -0.1301, -0.07834, 0.122, -0.1684, -0.0682),
        (0.2486, -0.08918, -0.05826, -0.357, 0.08872, 0.3154, -0.01013, -0.1634, -0.1722, 0.0393, 0.2693, -0.2614, -0.29, -0.09359, -0.5714, 0.1882, -0.2947, -0.1472, -0.008949, 0.1202, -0.124, -0.1887, -0.08631, -0.1103),
        (-0.1285, 0.07686, 0.1421, -0.1304, 0.03475, 0.006298, 0.09543, -0.02303, 0.1213, -0.2218, -0.06891, -0.08722, 0.1261, -0.06416, -0.02818, 0.07738, 0.1674, 0.2233, -0.1363, -0.1411, -0.1641, 0.186, -0.1231, -0.2472),
        (-1.875, -0.2255, 0.02504, 0.5043, -0.2493, -0.2236, 0.14, -0.5623, -0.1717, -0.01975, 0.04796, 0.08082, 0.06782, 0.2058, 0.223, -0.04146, 0.4512, 0.02932, 0.05996, -0.04359, 0.1271, 0.05187, 0.1596, 0.2552),
        (1.19, 0.3072, 0.2194, -0.3766, -0.009463, -0.2391, 0.2554, -0.3932, -0.3088, 0.1847, -0.1849, -0.0918, -0.4105, 0.0004734, 0.2073, 0.06604, 0.2315, -0.1255, 0.04388, 0.1405, -0.09048, -0.06385, 0.1983, 0.036),
    ),
    (
        (-0.3045, 0.3613, -0.1685, 0.1958, -0.04585, -0.007903, 0.7499, -0.1213, 0.1487, -0.1928, -0.001654, 0.2158, 0.1418, 0.1867, 0.3284, 0.4084, -0.04946),
        (0.4102, 0.09314, 0.1105, -0.2603, -0.2274, 0.2314, 0.06925, -0.06379, 0.007203, 0.325, -0.03182, -0.1338, -0.07123, 0.2116, -0.06639, 0.4374, -0.1803),
        (-0.1504, -0.168, 0.05955, 0.07452, -0.06813, 0.1856, 0.08934, 0.1533, -0.05898, -0.159, -0.1701, -0.05425, 0.08738, 0.1704, -0.3036, -0.01116, 0.02514),
        (-0.02924, -0.1607, 0.02317, -0.3615, 0.2715, -0.1273, -0.07144, 0.09422, 0.1606, -0.267, -0.4024, -0.1222, -0.05013, -0.2893, 0.08691, -0.1297, 0.1935),
        (-0.1217, 0.3879, 0.1059, -0.2681, 0.1202, 0.03838, 0.09928, -0.1898, 0.1915, 0.1245, 0.006562, -0.008217, 0.3757, -0.1812, 0.1866, -0.01507, -0.08873),
        (0.3479, -0.1785, -0.1727, 0.6111, 0.2407, 0.04803, 0.187, -0.03929, 0.1957, 0.0766, 0.04823, 0.1621, 0.08977, -0.09661, -0.7926, 0.2107, 0.1466),
        (-0.02189, 0.2456, -0.1379, 0.1678, -0.2046, -0.148, 0.0467, 0.1061, 0.3802, 0.1303, -0.001657, 0.156, 0.2785, -0.1407, -0.3093, -0.05092, -0.01205),
        (0.002419, -0.877, -0.1775, 0.3656, 0.5012, -0.01915, -0.1785, -0.01152, 0.2842, -0.3679, -0.5504, -0.129, 0.1904, -0.1073, -0.1022, 0.7042, 0.1253),
        (-0.1655, 0.04341, 0.06047, -0.6763, 0.6581, -0.1474, -0.4467, -0.01395, 0.4331, 0.1181, -0.0945, -0.22, -0.5122, -0.06384, -0.3332, -0.3247, -0.1433),
        (-0.2171, -0.03093, -0.1939, -0.2478, -0.1432, 0.1509, -0.06335, 0.156, -0.2196, 0.06341, -0.1438, 0.028, 0.139, -0.2288, -0.1165, -0.0279, -0.2843),
        (-0.5847, 0.0576, -0.135, 0.006931, -0.1201, 0.1449, -0.7069, 0.1062, 0.2489, 0.1713, -0.216, 0.2329, 0.4085, -0.1464, 0.4596, 0.04558, 0.03883),
        (-0.1078, -0.06746, -0.1069, 0.254, 0.1726, -0.1017, 0.1717, -0.06036, 0.2608, 0.2805, -0.02422, -0.09241, 0.01895, 0.2412, -0.2063, -0.06169, 0.02069),
        (0.09903, -0.01257, -0.1835, 0.2501, 0.3172, -0.1355, 0.444, -0.05472, 0.1705, 0.1472, 0.4094, 0.02276, 0.003953, 0.06442, -0.318, -0.2524, 0.1515),
        (-0.2372, 0.1857, -0.2672, 0.4997, -0.07281, -0.008969, -0.07282, -0.1893, -0.449, -0.3935, -0.0869, 0.1027, 0.01364, 0.1725, -0.4352, -0.01438, 0.02238),
        (-0.029, 0.04474, -0.07845, -0.2276, -0.217, -0.115, -0.2346, 0.1705, -0.8387, 0.06446, -0.7963, 0.05305, -0.3263, 0.1676, 0.6889, 0.4335, 0.08721),
        (0.01505, 0.6161, -0.1166, -0.6205, 0.1771, 0.01311, -0.3589, 0.2258, -0.005654, -0.1119, -0.04596, 0.1149, -0.0874, 0.1227, 0.5186, -0.09498, 0.05132),
    ),
    (
        (-0.2054, -0.3934, 0.02289, 0.05191, -0.2241, -0.00991, -0.3087, -0.2291, 0.7785, 0.09669, -0.3586, -0.12, 0.191, 0.7042, -0.08097, 0.3588, -0.2437),
        (-0.03721, -0.3251, -0.07736, 0.1402, -0.1077, -0.05414, -0.1547, 0.7978, 0.1157, 0.1675, -0.04456, -0.3304, -0.3603, 0.08124, 0.178, -0.1579, 0.0902),
        (-0.01615, -0.283, -0.1546, 0.3059, 0.09405, -0.2036, 0.01938, -0.02712, 0.1196, 0.1216, 0.6383, 0.2716, -0.2038, 0.1425, -0.03157, 0.1043, -0.3404),
        (-0.8376, 0.1034, 0.0538, -0.1306, 0.2854, -0.3196, -0.04753, -0.1479, -0.1451, -0.2307, 0.2026, -0.1841, -0.006565, 0.2276, 0.3952, -0.8022, 0.008365),
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
