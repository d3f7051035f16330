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
COUNTING = ()  # places of what counts from the start of the acting
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
        (-0.03231, 0.9657, -0.02224, 0.05236, -1.074, 0.0571, -0.1172, -0.1819, -0.195, 0.09176, -0.004148, -0.03299, 0.2821),
        (0.05834, 0.3291, -0.04996, -0.01971, -0.4793, -0.2315, 0.01716, 0.254, -0.05362, 0.3488, -0.3855, 0.06417, 0.354),
        (0.1147, -0.1652, -0.7676, 0.05182, 0.2544, 0.13, 0.0949, 0.05067, 0.1853, -0.2044, -0.5897, -0.1515, 0.1912),
        (0.436, 0.2916, -0.5358, -0.03924, 0.04385, 0.004977, 0.4768, 1.169, -1.136, -0.03625, 0.08934, -0.1798, 0.00711),
        (-0.1254, 0.2235, 0.3403, 0.1222, -0.2648, -0.5202, -0.04904, -0.3181, 0.2765, 0.1237, -0.2464, 0.2179, 0.1531),
        (0.09478, 0.6369, -0.604, -0.2552, -0.4051, 0.3657, 0.03607, 0.1103, 0.3785, -0.4104, 0.0715, 0.02732, 0.32),
        (-0.02286, -0.03156, -0.6521, -0.07505, -0.008706, 0.7972, -0.02575, -0.06637, 0.002174, 0.2167, -0.2288, -0.01566, 0.119),
        (-0.03906, -0.1473, 0.007399, 0.05766, 0.1266, -0.02711, -0.05751, -0.7806, 1.483, -0.1184, -0.3982, 0.7297, 0.3039),
        (0.2735, -0.06694, 0.0609, -0.08359, 0.01151, 0.07233, -0.3442, -1.222, 2.2, -0.0339, 0.1841, -0.09821, 0.1332),
        (0.1147, -0.07482, -0.3248, -0.01332, 0.1072, 0.1004, 0.4424, 0.2672, -0.1462, 0.4218, 0.1826, 0.3869, 0.2156),
        (0.2665, -0.08584, 0.1764, 0.2152, 0.1052, -0.2864, -0.7137, -0.8378, 1.532, -0.409, -0.05578, -0.3645, -0.1144),
        (0.4655, -0.3571, 0.0572, -0.5921, 0.2846, -0.074, -0.1117, -0.06583, -0.06004, 0.239, -0.1802, 0.03276, 0.367),
        (-0.5275, 0.05086, -0.09292, 0.545, 0.02051, 0.1109, 0.2114, 0.05978, -0.2092, 0.1443, -0.06471, -0.02575, 0.4065),
        (0.5896, 0.2952, 0.1025, -0.5562, -0.3872, -0.08125, 0.04887, -0.09983, -0.07327, 0.2149, -0.2095, 0.1029, 0.3393),
        (0.01582, -0.1226, 0.9494, 0.06965, 0.134, -0.9697, 0.07007, -0.0186, 0.05435, 0.1826, -0.1012, 0.1072, 0.1819),
        (-0.006629, -0.1408, -0.4997, 0.1041, 0.05517, 0.1763, -0.2486, -0.2737, -0.08802, 0.1793, 0.346, 0.5853, 0.6367),
    ),
    (
        (0.02669, 0.3557, 0.3482, 0.1685, 0.1509, -0.2497, -0.2301, -0.1647, 0.3381, 0.2453, 0.0271, 0.4619, 0.05264, 0.08169, 0.2059, -0.2845, 0.2714),
        (-0.6141, -0.2744, 0.1827, 0.09366, -0.06706, -0.1606, 0.2038, 0.1412, -0.1668, -0.02631, 0.1837, 0.5643, 0.3575, -0.3364, -0.0308, 0.1215, 0.1863),
        (-0.2515, 0.1969, 0.5809, -2.384, 0.4768, 0.3709, 0.1666, -2.288, 0.7126, -0.7183, 0.8198, 0.1133, -0.1672, -0.2825, -0.2215, -1.112, -0.1761),
        (0.2369, 0.006993, 0.2125, -0.008136, -0.05325, -0.7569, -0.08846, -0.3244, 0.2441, 0.2756, -0.01464, -0.1656, 0.2389, 0.2544, -0.0731, 0.2225, 0.02757),
        (0.216, 0.003358, 0.01511, -0.09459, -0.1381, 0.09284, -0.5023, -0.1358, 0.1112, 0.06339, 0.04296, -0.08159, 0.5262, -0.2649, 0.3006, -0.05285, 0.417),
        (-0.2886, -0.2604, -0.2089, 0.02886, -0.2331, -0.1428, -0.01877, 0.1654, -0.2418, -0.1598, 0.1232, -0.2794, 0.09816, 0.1813, -0.2693, 0.0516, -0.1165),
        (-0.09208, 0.323, 0.1046, 0.03877, -0.1311, -0.08982, 0.05048, -0.2679, -3.375, -0.2219, -2.232, 0.1894, 0.2931, 0.009955, 0.02419, -0.03527, 0.1311),
        (0.3555, -0.2979, 0.2933, 0.1431, -0.5879, 0.1361, 0.5876, 0.1018, 0.01541, 0.0116, -0.08436, -0.08776, 0.205, 0.1256, -1.006, 0.3059, 0.08575),
        (0.1254, -0.03335, 0.1704, 0.2476, 0.3457, -0.103, -0.1764, -0.03538, -0.2763, -0.3392, 0.3321, 0.2813, -0.02595, 0.07508, 0.2902, 0.1804, -0.01734),
        (-0.06451, -0.134, 0.3043, 0.07829, -0.197, -0.6258, 0.1797, -0.1099, 0.03691, 0.1573, 0.3122, 0.281, 0.3383, -0.06817, -0.09124, 0.1479, 0.1612),
        (-0.01494, 0.08591, 0.2311, 0.06605, 0.1044, 0.4119, 0.402, -0.04463, 0.05111, 0.3145, 0.2221, 0.1915, -0.263, 0.1205, 0.2006, -0.2121, 0.0467),
        (0.3332, -0.1388, -0.2192, 0.2083, -0.02799, 0.1341, 0.03554, -0.1354, -0.2278, -0.3102, 0.2307, 0.3101, -0.01757, 0.3739, 0.133, 0.3072, 0.318),
        (0.3636, -0.09582, 0.2155, 0.1983, 0.1507, -0.2465, 0.1592, 0.1167, -0.2047, 0.2503, 0.1667, -0.4105, 0.2038, -0.3675, -0.1432, 0.364, 0.1739),
        (-0.5161, 0.09963, 0.02625, -0.03869, -0.1823, 0.154, -0.008797, 0.2404, -0.07315, -0.06254, 0.08215, -0.3708, 0.4492, -0.3768, 0.1759, 0.159, 0.1642),
        (0.3897, 0.2624, 0.2358, -0.009969, 0.0411, -0.1323, 0.3162, 0.03687, 0.05517, -0.04772, 0.1812, -0.1143, 0.07712, -0.3128, 0.04666, 0.0001322, 0.06215),
        (-0.5603, -0.2316, 0.1681, 0.006119, -0.3002, -0.3364, -0.1245, -0.03415, 0.0195, -0.1761, 0.0366, 0.6321, 0.3886, -0.3241, 0.4363, 0.2902, 0.2823),
    ),
    (
        (-0.3579, 0.0707, -2.048, 0.02781, -0.0668, -0.189, 1.682, 0.04032, 0.3433, -0.03963, -0.1184, 0.2786, 0.1608, -0.1052, -0.175, 0.0298, -0.2286),
        (-0.1465, -0.1873, -0.04982, -0.2357, 0.4883, 0.05476, 0.3234, -0.02277, -0.1272, -0.02109, -0.3321, -0.3059, 0.5426, 0.2583, 0.474, 0.2043, -0.2434),
        (-0.04535, 0.6997, 0.001577, -0.3157, -0.03265, -0.06658, -0.05144, 0.01298, 0.2058, 0.3371, -0.1305, -0.2047, 0.003343, -0.04063, -0.2925, 0.5202, -0.2463),
        (-0.3264, 0.2287, -0.1672, -0.3174, -0.4222, 0.146, 0.4906, 0.7443, -0.3145, 0.2348, 0.1677, -0.07803, 0.1724, -0.1054, 0.11, -0.3145, -0.01104),
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
