# A network that learned RoboArm-v0
# Robot: robo-arm
# Program of the robot "robo-arm" for the prime hub, written by BricksRL from the robot's description.
# Do not edit: it is written anew whenever the description changes.
# Commands, in the order of the action:
#   rotation: turn by -100 to 100 deg at 250 deg/s
#   low: turn by -30 to 30 deg at 250 deg/s
#   high: turn by -60 to 60 deg at 250 deg/s
#   grab: turn by -25 to 25 deg at 250 deg/s
# Channels, in the order of the observation:
#   rotation_angle, 0 to 360 deg
#   low_angle, 10 to 70 deg
#   high_angle, -150 to 10 deg
#   grab_angle, -148 to -45 deg
# It acts by itself, by a network that learned RoboArm-v0, until the center button is pressed.

from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import StopWatch, wait
import umath
from urandom import randint, uniform


UNTIL_DONE = False  # a step ends when all moves have ended
SETTLE_MS = 250  # and after this time in any case
AGE_MS = 110  # age of an observation when its commands start
# Middle and half of each command's range, times its scale.
SPANS = ((0.0, 1000.0), (0.0, 300.0), (0.0, 600.0), (0.0, 250.0))


class Joint:
    """A motor that never gets a target outside of its range."""

    def __init__(self, motor, low, high):
        self.motor = motor
        self.low = low
        self.high = high
        self.target = None
        self.angle = motor.angle
        self.done = motor.done

    def turn(self, speed, angle):
        # Count from the held target: counting from the measured angle, a joint that sags a little
        # under its load would creep down with every step.
        if self.target is None or not self.motor.done():
            self.target = self.motor.angle()
        self.target = max(self.low, min(self.high, self.target + angle))
        self.motor.run_target(speed, self.target, wait=False)

    def stop(self):
        self.target = None
        self.motor.stop()


hub = PrimeHub()
motor_rotation = Motor(Port.B, gears=[20, 60])
motor_low = Motor(Port.D)
motor_low.control.limits(speed=500, acceleration=1000, torque=900)
motor_low = Joint(motor_low, 10, 70)
motor_high = Motor(Port.A)
motor_high = Joint(motor_high, -150, 10)
motor_grab = Motor(Port.E)
motor_grab = Joint(motor_grab, -148, -45)

MOVERS = [motor_rotation, motor_low, motor_high, motor_grab]


def start_moves(actions):
    """Start the commands, clamped to their ranges, without waiting for their ends."""
    motor_rotation.run_angle(250, whole(actions[0], -1000, 1000, 10), wait=False)
    motor_low.turn(250, whole(actions[1], -300, 300, 10))
    motor_high.turn(250, whole(actions[2], -600, 600, 10))
    motor_grab.turn(250, whole(actions[3], -250, 250, 10))


GOALS = ((0.0, 360.0), (10.0, 70.0), (-150.0, 10.0), (-148.0, -45.0))  # lowest and highest value; whole numbers if both are
GOAL_STEPS = 100  # steps after which they are drawn anew


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
    return [
        motor_rotation.angle() % 360,
        motor_low.angle(),
        motor_high.angle(),
        motor_grab.angle(),
    ] + goals()


LINEAR = (  # index, factor and offset of what is no angle; its least and its greatest value
    (1, 0.03333, -1.333, 9, 75),
    (2, 0.0125, 0.875, -148, 8),
    (3, 0.01942, 1.874, -147, -47),
    (5, 0.03333, -1.333, 10.01, 69.99),
    (6, 0.0125, 0.875, -149.7, 9.792),
    (7, 0.01942, 1.874, -147.9, -45.07),
)
ANGLES = ((0, 8), (4, 8), (0, 4))  # indices of two angles, or of one and of a 0 that follows the last
LAYERS = (  # a row for each unit: its weights, then its offset
    (
        (-0.03946, 0.9804, -0.01882, 0.05659, -1.077, 0.05411, -0.1113, -0.1822, -0.1997, 0.09537, -0.0125, -0.02926, 0.2743),
        (0.05086, 0.2919, -0.06058, -0.02017, -0.4629, -0.2202, 0.0277, 0.2713, -0.04829, 0.3414, -0.3718, 0.05749, 0.3582),
        (0.1394, -0.2212, -0.7867, 0.04644, 0.2883, 0.1006, 0.08024, 0.05645, 0.2079, -0.1837, -0.5809, -0.1276, 0.1919),
        (0.4079, 0.2628, -0.5177, -0.0248, 0.04115, 0.006807, 0.4911, 1.178, -1.141, -0.0337, 0.0884, -0.1816, 0.00978),
        (-0.1103, 0.2081, 0.3164, 0.1244, -0.2489, -0.5103, -0.06796, -0.3143, 0.2934, 0.1249, -0.2418, 0.2081, 0.1536),
        (0.1596, 0.6508, -0.5751, -0.2868, -0.4245, 0.3145, -0.004461, 0.0844, 0.3601, -0.366, 0.07809, 0.04308, 0.3969),
        (-0.03176, -0.04088, -0.6507, -0.08279, -0.0103, 0.7903, -0.02854, -0.0844, -0.008383, 0.2256, -0.2264, -0.01563, 0.1196),
        (-0.02108, -0.1358, 0.04575, 0.04175, 0.1374, -0.06453, -0.06291, -0.763, 1.46, -0.1217, -0.4121, 0.7293, 0.2942),
        (0.2762, -0.02511, 0.06464, -0.08678, 0.02066, 0.06858, -0.3132, -1.232, 2.19, -0.039, 0.1827, -0.09759, 0.1366),
        (0.139, -0.1081, -0.327, -0.03289, 0.125, 0.1048, 0.439, 0.28, -0.1585, 0.4195, 0.1591, 0.3932, 0.217),
        (0.2835, -0.02939, 0.1681, 0.2133, 0.1039, -0.2861, -0.7221, -0.8144, 1.546, -0.4, -0.04842, -0.3588, -0.1137),
        (0.4619, -0.3661, 0.0456, -0.5892, 0.299, -0.06149, -0.109, -0.07494, -0.0503, 0.2395, -0.1685, 0.04752, 0.3768),
        (-0.5093, 0.05851, -0.09432, 0.5471, 0.01076, 0.1203, 0.2126, 0.05496, -0.2012, 0.1341, -0.06591, -0.02491, 0.4079),
        (0.5945, 0.2868, 0.1201, -0.5438, -0.3851, -0.1009, 0.05064, -0.08962, -0.07368, 0.2083, -0.2159, 0.1014, 0.3422),
        (0.0003047, -0.1236, 0.9263, 0.06527, 0.1229, -0.9758, 0.0642, -0.04847, 0.03301, 0.1921, -0.1122, 0.1147, 0.1966),
        (0.004149, -0.1362, -0.5291, 0.08339, 0.06656, 0.196, -0.2522, -0.2854, -0.1067, 0.1823, 0.3363, 0.5761, 0.6285),
    ),
    (
        (0.01708, 0.3488, 0.3247, 0.1614, 0.1556, -0.2001, -0.2258, -0.1659, 0.3386, 0.2414, 0.039, 0.4493, 0.04076, 0.08194, 0.2109, -0.2881, 0.2676),
        (-0.6114, -0.2669, 0.1862, 0.09709, -0.06408, -0.1664, 0.1913, 0.1376, -0.1715, -0.02827, 0.1785, 0.5672, 0.3613, -0.3259, -0.03814, 0.1166, 0.1879),
        (-0.2596, 0.1899, 0.5933, -2.39, 0.4781, 0.4231, 0.1923, -2.254, 0.7196, -0.7155, 0.8153, 0.1122, -0.1363, -0.3022, -0.2296, -1.086, -0.1661),
        (0.246, 0.01162, 0.2137, -0.005603, -0.0259, -0.7621, -0.09581, -0.3293, 0.2509, 0.269, -0.005972, -0.1525, 0.2257, 0.2664, -0.05712, 0.2369, 0.02921),
        (0.2178, 0.003794, 0.01596, -0.08911, -0.1523, 0.09746, -0.5034, -0.1322, 0.1128, 0.06081, 0.04204, -0.09258, 0.5231, -0.2676, 0.2997, -0.04827, 0.4191),
        (-0.2886, -0.2604, -0.2089, 0.02886, -0.2331, -0.1428, -0.01877, 0.1654, -0.2418, -0.1598, 0.1232, -0.2794, 0.09816, 0.1813, -0.2693, 0.0516, -0.1165),
        (-0.09338, 0.3224, 0.09725, 0.0374, -0.1369, -0.07676, 0.04802, -0.2517, -3.349, -0.2221, -2.221, 0.1945, 0.2895, 0.0167, 0.02925, -0.04091, 0.131),
        (0.3524, -0.301, 0.3066, 0.1397, -0.5511, 0.1681, 0.5843, 0.1054, 0.01589, 0.01728, -0.08821, -0.08271, 0.2305, 0.1192, -1.006, 0.2959, 0.08469),
        (0.1262, -0.03503, 0.1697, 0.2435, 0.3366, -0.1023, -0.1801, -0.04329, -0.2719, -0.3425, 0.3218, 0.2891, -0.01959, 0.08354, 0.2896, 0.1824, -0.0159),
        (-0.05222, -0.1239, 0.298, 0.07875, -0.1824, -0.6608, 0.1602, -0.1071, 0.04355, 0.1701, 0.3256, 0.2846, 0.3455, -0.05357, -0.06855, 0.1594, 0.1663),
        (-0.0227, 0.07116, 0.2215, 0.0697, 0.1133, 0.406, 0.4081, -0.03957, 0.04844, 0.3122, 0.2278, 0.1915, -0.2554, 0.1083, 0.1973, -0.2129, 0.04344),
        (0.3419, -0.1346, -0.212, 0.216, -0.02095, 0.1339, 0.04982, -0.14, -0.2237, -0.3155, 0.2226, 0.3169, -0.01007, 0.3702, 0.1229, 0.2951, 0.3141),
        (0.3671, -0.09364, 0.2066, 0.1897, 0.1556, -0.2809, 0.1566, 0.1285, -0.1948, 0.2565, 0.1605, -0.4152, 0.208, -0.362, -0.1448, 0.3725, 0.1719),
        (-0.5102, 0.1183, 0.01944, -0.03639, -0.195, 0.1494, -0.005789, 0.2344, -0.08516, -0.05705, 0.0923, -0.3672, 0.4391, -0.3831, 0.1895, 0.1504, 0.1604),
        (0.3857, 0.2625, 0.2361, -0.01722, 0.04319, -0.1264, 0.316, 0.04244, 0.05472, -0.04446, 0.1808, -0.1174, 0.07553, -0.3133, 0.05641, 0.00466, 0.06252),
        (-0.5617, -0.2255, 0.171, 0.01145, -0.3075, -0.3161, -0.1245, -0.03645, 0.02328, -0.1843, 0.03458, 0.6339, 0.3884, -0.3155, 0.4385, 0.2877, 0.2886),
    ),
    (
        (-0.3481, 0.07033, -2.036, 0.02104, -0.07126, -0.189, 1.672, 0.04266, 0.3501, -0.03918, -0.1201, 0.2731, 0.1673, -0.09767, -0.1816, 0.03338, -0.2331),
        (-0.1455, -0.1875, -0.0512, -0.2365, 0.4886, 0.05476, 0.3286, -0.02314, -0.1242, -0.02186, -0.3313, -0.3042, 0.5453, 0.2601, 0.4771, 0.2105, -0.2396),
        (-0.04623, 0.6955, 0.01393, -0.3432, -0.02821, -0.06658, -0.04372, 0.01031, 0.1928, 0.3458, -0.13, -0.2009, -0.001446, -0.04074, -0.2825, 0.515, -0.2428),
        (-0.324, 0.2252, -0.1356, -0.31, -0.427, 0.146, 0.5062, 0.7368, -0.31, 0.2488, 0.1591, -0.09722, 0.1731, -0.1086, 0.1069, -0.3175, -0.01919),
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


CLOCK = StopWatch()


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
    try:
        while True:
            observed = observe()
            seen_ms = CLOCK.time()
            commands = [
                round(middle + half * action)
                for (middle, half), action in zip(SPANS, act(observed))
            ]
            computed_ms = CLOCK.time() - seen_ms
            wait(max(0, AGE_MS - computed_ms))
            started_ms = CLOCK.time()
            start_moves(commands)
            print(computed_ms, *observed, *commands)
            settle(started_ms)
    finally:
        stop_motors()


live()
