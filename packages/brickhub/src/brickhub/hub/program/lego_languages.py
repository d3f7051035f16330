"""Programs in LEGO's own Python, which are taken for Pybricks': what they are, and what each of
their lines is in Pybricks.

Names are those of LEGO's documentation: SPIKE Prime 2 (module ``spike``), MINDSTORMS Robot Inventor
(``mindstorms``, the same names), SPIKE Prime 3 (``motor``, ``runloop``, ``hub.port`` ...), and of
the project ev3dev (``ev3dev2``), which is not LEGO's but is found in the same places.
"""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from brickhub.hub.program.syntax import parse
from brickhub.hub.transport import HubProgram


@dataclass(frozen=True)
class Language:
    """A language that a hub with Pybricks does not run.

    Attributes:
        name: what a program in it is called in a message.
        modules: modules of which one is enough to know it.
        uses: what Pybricks has in place of a name, or of ``module.name``.
    """

    name: str
    modules: tuple[str, ...]
    uses: Mapping[str, str]


_WAIT = "wait(milliseconds) of pybricks.tools"
_LOOP = "a loop: while not ...: wait(10)"
_NO_APP = "there is no app beside the hub; print() writes to the computer"
_IMU_FACE = "PrimeHub(top_side=..., front_side=...) says how the hub is mounted"
_DRIVE_BASE = "DriveBase(left, right, wheel_diameter, axle_track) of pybricks.robotics"
_DRIVE = "drive(speed, turn_rate) of a DriveBase, in mm/s and deg/s"
_STRAIGHT = "straight(mm), turn(degrees) or curve(radius, degrees) of a DriveBase"
_TANK = "left.run(speed) and right.run(speed), in deg/s"
_STOPS = "stop() lets it roll, brake() and hold() are methods of their own"
_ICON = "hub.display.icon(Icon.HAPPY), with Icon of pybricks.parameters"
_PIXEL = "hub.display.pixel(row, column, brightness), which count from 0"
_BUTTONS = "Button.LEFT in hub.buttons.pressed()"
_BEEP = "hub.speaker.beep(frequency, duration), in Hz and ms"
_TILT = "hub.imu.tilt(), which is pitch and roll"
_SENSOR_LIGHTS = "sensor.lights.on(brightness)"
_SPEEDS = "give the speed with each command, in deg/s"
_COMPARISON = "a comparison, such as a > b"
_WATCH = "time() of a StopWatch of pybricks.tools, in ms"

_SPIKE_2 = {
    "light_matrix.show_image": _ICON,
    "light_matrix.write": "hub.display.text(text)",
    "light_matrix.set_pixel": _PIXEL,
    "light_matrix.off": "hub.display.off()",
    "status_light.on": "hub.light.on(Color.RED), with Color of pybricks.parameters",
    "status_light.off": "hub.light.off()",
    "speaker.beep": f"{_BEEP}: note 60 is 262 Hz",
    "speaker.start_beep": _BEEP,
    "speaker.set_volume": "hub.speaker.volume(percent)",
    "speaker.get_volume": "hub.speaker.volume()",
    "play_sound": "there are no sound files; hub.speaker.play_notes([...])",
    "start_sound": "there are no sound files; hub.speaker.play_notes([...])",
    "get_yaw_angle": "hub.imu.heading(), clockwise positive",
    "reset_yaw_angle": "hub.imu.reset_heading(0)",
    "get_pitch_angle": _TILT,
    "get_roll_angle": _TILT,
    "get_orientation": "hub.imu.up(), which is a Side",
    "wait_for_new_orientation": _LOOP,
    "get_gesture": "hub.imu.acceleration() shows a shake or a fall",
    "was_gesture": "hub.imu.acceleration() shows a shake or a fall",
    "wait_for_new_gesture": _LOOP,
    "left_button": _BUTTONS,
    "right_button": _BUTTONS.replace("LEFT", "RIGHT"),
    "run_for_rotations": "run_angle(speed, 360 * rotations), with the speed in deg/s",
    "run_for_degrees": "run_angle(speed, degrees), with the speed in deg/s",
    "run_for_seconds": "run_time(speed, 1000 * seconds), with the speed in deg/s",
    "run_to_position": "run_target(speed, angle), with the speed in deg/s",
    "run_to_degrees_counted": "run_target(speed, angle), with the speed in deg/s",
    "start": f"run(speed), in deg/s; of a pair {_DRIVE}",
    "start_at_power": "dc(percent)",
    "get_speed": "speed(), in deg/s",
    "get_position": "angle(), not wrapped",
    "get_degrees_counted": "angle()",
    "set_degrees_counted": "reset_angle(degrees)",
    "get_default_speed": _SPEEDS,
    "set_default_speed": f"{_SPEEDS}; for a DriveBase settings(straight_speed)",
    "set_stop_action": f"{_STOPS}, and then=Stop.COAST, BRAKE or HOLD of a move",
    "was_interrupted": "done() and stalled()",
    "was_stalled": "stalled()",
    "set_stall_detection": "run_until_stalled(speed) looks for a stop",
    "move": _STRAIGHT,
    "start_tank": _TANK,
    "move_tank": "left.run_angle(speed, degrees, wait=False) and right.run_angle(speed, degrees)",
    "start_tank_at_power": "left.dc(percent) and right.dc(percent)",
    "set_motor_rotation": "wheel_diameter of the DriveBase, in mm",
    "get_color": "color(), which is a Color and no text",
    "get_reflected_light": "reflection()",
    "get_ambient_light": "ambient()",
    "get_rgb_intensity": "hsv(), with .h, .s and .v",
    "get_red": "hsv(), with .h, .s and .v",
    "get_green": "hsv(), with .h, .s and .v",
    "get_blue": "hsv(), with .h, .s and .v",
    "wait_until_color": _LOOP,
    "wait_for_new_color": _LOOP,
    "get_distance_cm": "distance(), in mm",
    "get_distance_inches": "distance(), in mm",
    "get_distance_percentage": "distance(), in mm",
    "wait_for_distance_farther_than": _LOOP,
    "wait_for_distance_closer_than": _LOOP,
    "light_up": _SENSOR_LIGHTS,
    "light_up_all": _SENSOR_LIGHTS,
    "is_pressed": "pressed() of a ForceSensor; for the hub's buttons hub.buttons.pressed()",
    "was_pressed": _BUTTONS,
    "get_force_newton": "force(), in newtons",
    "get_force_percentage": "force(), in newtons",
    "wait_until_pressed": _LOOP,
    "wait_until_released": _LOOP,
    "wait_for_seconds": f"{_WAIT}: 1000 * seconds",
    "wait_until": _LOOP,
    "equal_to": _COMPARISON,
    "not_equal_to": _COMPARISON,
    "greater_than": _COMPARISON,
    "greater_than_or_equal_to": _COMPARISON,
    "less_than": _COMPARISON,
    "less_than_or_equal_to": _COMPARISON,
    "now": "time() of a StopWatch, in ms",
    "Timer": "StopWatch() of pybricks.tools: time() in ms, reset()",
    "MSHub": "InventorHub() of pybricks.hubs, or PrimeHub(), which is the same hub",
    "PrimeHub": "PrimeHub() of pybricks.hubs",
    "Motor": "Motor(Port.A) of pybricks.pupdevices, with Port of pybricks.parameters",
    "MotorPair": _DRIVE_BASE,
    "ColorSensor": "ColorSensor(Port.A) of pybricks.pupdevices",
    "DistanceSensor": "UltrasonicSensor(Port.A) of pybricks.pupdevices",
    "ForceSensor": "ForceSensor(Port.A) of pybricks.pupdevices",
    "App": _NO_APP,
}
_SPIKE_3 = {
    "runloop.run": "run_task(main()) of pybricks.tools; several: await multitask(...)",
    "runloop.sleep_ms": "await wait(milliseconds) of pybricks.tools",
    "runloop.until": "a loop: while not ...: await wait(10)",
    "motor.run": "Motor(Port.A).run(speed), in deg/s too",
    "motor.run_for_degrees": "run_angle(speed, degrees): the speed comes first",
    "motor.run_for_time": "run_time(speed, milliseconds): the speed comes first",
    "motor.run_to_absolute_position": "run_target(speed, angle): the speed comes first",
    "motor.run_to_relative_position": "run_target(speed, angle): the speed comes first",
    "motor.stop": _STOPS,
    "motor.velocity": "speed(), in deg/s too",
    "motor.relative_position": "angle()",
    "motor.absolute_position": "angle(), not wrapped",
    "motor.reset_relative_position": "reset_angle(degrees)",
    "motor.set_duty_cycle": "dc(percent)",
    "motor.get_duty_cycle": "load() and speed() tell what a motor does",
    "motor_pair.pair": _DRIVE_BASE,
    "motor_pair.unpair": "a DriveBase stays what it is",
    "motor_pair.move": _DRIVE,
    "motor_pair.move_for_degrees": _STRAIGHT,
    "motor_pair.move_for_time": f"{_DRIVE}, then wait(milliseconds) and stop()",
    "motor_pair.move_tank": _TANK,
    "motor_pair.move_tank_for_degrees": "left.run_angle(...) and right.run_angle(...)",
    "motor_pair.move_tank_for_time": "left.run_time(...) and right.run_time(...)",
    "motor_pair.stop": "stop() or brake() of the DriveBase",
    "color_sensor.color": "ColorSensor(Port.A).color(), which is a Color and no number",
    "color_sensor.reflection": "ColorSensor(Port.A).reflection()",
    "color_sensor.rgbi": "ColorSensor(Port.A).hsv(), with .h, .s and .v",
    "distance_sensor.distance": "UltrasonicSensor(Port.A).distance(): 2000 for nothing, not -1",
    "distance_sensor.show": "UltrasonicSensor(Port.A).lights.on(...)",
    "distance_sensor.set_pixel": "UltrasonicSensor(Port.A).lights.on(...)",
    "distance_sensor.clear": "UltrasonicSensor(Port.A).lights.off()",
    "force_sensor.force": "ForceSensor(Port.A).force(), in newtons and not tenths of them",
    "force_sensor.pressed": "ForceSensor(Port.A).pressed()",
    "force_sensor.raw": "ForceSensor(Port.A).force(), in newtons",
    "light_matrix.write": "hub.display.text(text)",
    "light_matrix.show_image": _ICON,
    "light_matrix.show": "hub.display.icon(matrix)",
    "light_matrix.set_pixel": _PIXEL,
    "light_matrix.get_pixel": "the program knows what it has shown",
    "light_matrix.clear": "hub.display.off()",
    "light.color": "hub.light.on(Color.RED), with Color of pybricks.parameters",
    "sound.beep": _BEEP,
    "sound.stop": "beep() ends by itself",
    "sound.volume": "hub.speaker.volume(percent)",
    "motion_sensor.tilt_angles": f"hub.imu.heading() in degrees, not tenths; {_TILT}",
    "motion_sensor.reset_yaw": "hub.imu.reset_heading(0)",
    "motion_sensor.set_yaw_face": _IMU_FACE,
    "motion_sensor.get_yaw_face": _IMU_FACE,
    "motion_sensor.up_face": "hub.imu.up(), which is a Side",
    "motion_sensor.stable": "hub.imu.stationary()",
    "motion_sensor.acceleration": "hub.imu.acceleration(), in mm/s2",
    "motion_sensor.angular_velocity": "hub.imu.angular_velocity(), in deg/s",
    "motion_sensor.gesture": "hub.imu.acceleration() shows a tap or a shake",
    "motion_sensor.tap_count": "hub.imu.acceleration() shows a tap or a shake",
    "button.pressed": _BUTTONS,
    "port": "Port of pybricks.parameters",
    "runloop": "run_task, multitask and wait of pybricks.tools",
    "color": "Color of pybricks.parameters",
    "color_matrix": "a color light matrix: ColorLightMatrix of pybricks.pupdevices",
    "orientation": "hub.display.orientation(Side.TOP)",
    "device": "iodevices.PUPDevice(Port.A) tells what is plugged in",
    "time": "wait and StopWatch of pybricks.tools",
    "time.sleep": f"{_WAIT}: 1000 * seconds",
    "time.sleep_ms": _WAIT,
    "time.ticks_ms": _WATCH,
    "time.ticks_diff": _WATCH,
    "hub.power_off": "hub.system.shutdown()",
    "app": _NO_APP,
    "app.sound": _NO_APP,
    "sound.play": _NO_APP,
    "linegraph": _NO_APP,
    "bargraph": _NO_APP,
    "display": _NO_APP,
    "music": _NO_APP,
}
_HUB_MODULE = {
    "hub.port": "Motor(Port.A), ColorSensor(Port.A) ... of pybricks.pupdevices",
    "hub.display": "display of PrimeHub() of pybricks.hubs",
    "hub.motion": "hub.imu of PrimeHub() of pybricks.hubs",
    "hub.sound": "hub.speaker.beep(frequency, duration)",
    "hub.button": _BUTTONS,
    "hub.led": "hub.light.on(Color.RED)",
    "hub.battery": "hub.battery.voltage()",
    "hub.Image": _ICON,
    "hub.info": "hub.system.info()",
    "hub.status": "hub.imu, hub.battery and hub.buttons",
    "hub.BT_VCP": _NO_APP,
    "hub.USB_VCP": _NO_APP,
    "runtime.VirtualMachine": "what the app has made of word blocks does not run; write it anew",
    "utime": "wait and StopWatch of pybricks.tools",
    "time": "wait and StopWatch of pybricks.tools",
}
_EV3DEV = {
    "LargeMotor": "Motor(Port.A) of pybricks.ev3devices",
    "MediumMotor": "Motor(Port.A) of pybricks.ev3devices",
    "MoveTank": _DRIVE_BASE,
    "MoveSteering": _DRIVE_BASE,
    "MoveDifferential": _DRIVE_BASE,
    "SpeedPercent": "a speed in deg/s",
    "on_for_rotations": "run_angle(speed, 360 * rotations)",
    "on_for_degrees": "run_angle(speed, degrees)",
    "on_for_seconds": "run_time(speed, 1000 * seconds)",
    "off": _STOPS,
    "run_forever": "run(speed)",
    "run_timed": "run_time(speed, milliseconds)",
    "run_to_rel_pos": "run_angle(speed, degrees)",
    "run_to_abs_pos": "run_target(speed, angle)",
    "TouchSensor": "TouchSensor(Port.S1) of pybricks.ev3devices",
    "ColorSensor": "ColorSensor(Port.S1) of pybricks.ev3devices",
    "UltrasonicSensor": "UltrasonicSensor(Port.S1) of pybricks.ev3devices",
    "GyroSensor": "GyroSensor(Port.S1) of pybricks.ev3devices",
    "InfraredSensor": "InfraredSensor(Port.S1) of pybricks.ev3devices",
    "run_direct": "dc(percent)",
    "position": "angle()",
    "is_pressed": "pressed()",
    "wait_for_pressed": _LOOP,
    "wait_for_bump": _LOOP,
    "reflected_light_intensity": "reflection()",
    "ambient_light_intensity": "ambient()",
    "distance_centimeters": "distance(), in mm",
    "distance_inches": "distance(), in mm",
    "Sound": "ev3.speaker.beep(); there is no voice",
    "speak": "the brick cannot speak; ev3.speaker.beep(frequency, duration)",
    "Sound.beep": "ev3.speaker.beep(frequency, duration)",
    "Leds": "ev3.light.on(Color.GREEN)",
    "set_color": "ev3.light.on(Color.GREEN)",
    "Display": "ev3.screen",
    "Button": "ev3.buttons.pressed()",
    "sleep": f"{_WAIT}: 1000 * seconds",
    "time": "wait and StopWatch of pybricks.tools",
    **{f"OUTPUT_{port}": f"Port.{port} of pybricks.parameters" for port in "ABCD"},
    **{f"INPUT_{port}": f"Port.S{port} of pybricks.parameters" for port in "1234"},
}

_ONLY_SPIKE_3 = ("hub.light_matrix", "hub.motion_sensor", "hub.light")
"""Parts of the module ``hub`` that the older one lacks: ``import hub`` alone does not tell them
apart."""

LANGUAGES = (
    Language("LEGO's MINDSTORMS app (Robot Inventor)", ("mindstorms",), _SPIKE_2),
    Language("LEGO's SPIKE app 2", ("spike",), _SPIKE_2),
    Language(
        "LEGO's SPIKE app 3",
        (
            "runloop",
            "motor",
            "motor_pair",
            "color_sensor",
            "distance_sensor",
            "force_sensor",
            "color_matrix",
            "hub.port",
            "hub.light_matrix",
            "hub.motion_sensor",
            "hub.light",
            "hub.sound",
            "hub.button",
        ),
        _SPIKE_3,
    ),
    Language("the hub module of LEGO's SPIKE app 2 or MINDSTORMS app", ("hub",), _HUB_MODULE),
    Language("ev3dev, another system for the EV3", ("ev3dev2", "ev3dev"), _EV3DEV),
)
"""Those that are told apart, the plainest signs first."""


def language_of(program: HubProgram) -> Language | None:
    """The language of a program that is not Pybricks'; ``None`` for all others. What imports
    Pybricks, has a module of that name beside it, or uses nothing of that language, is
    Pybricks'."""
    try:
        tree = parse(program.source)
    except (SyntaxError, ValueError):
        # The hub's compiler says what is wrong.
        return None
    own = {module.name for module in program.modules}
    imported = set(_imported(tree))
    roots = {name.partition(".")[0] for name in imported}
    imported |= set(_hub_parts(tree)) & set(_ONLY_SPIKE_3)
    # Who catches a failed import is prepared for Pybricks.
    if "pybricks" in roots or _catches_import_errors(tree):
        return None
    for language in LANGUAGES:
        known = [name for name in language.modules if name.partition(".")[0] not in own]
        if any(name in imported or name in roots for name in known):
            # A module "motor" may also be a file of the program's that was forgotten.
            return language if any(_uses(tree, language)) else None
    return None


def language_note(program: HubProgram) -> str:
    """Text that names the language of a program that is not Pybricks', and what each of its lines
    is in Pybricks; empty for others."""
    language = language_of(program)
    if language is None:
        return ""
    lines = [f"This program is for {language.name}; Pybricks has other names:\n"]
    for line, what, instead in other_lines(program, language):
        lines.append(f"  line {line}: {what}: {instead}\n")
    return "".join(lines)


def other_lines(program: HubProgram, language: Language) -> list[tuple[int, str, str]]:
    """Lines that are other in Pybricks: number, what stands there, and what Pybricks has; each
    thing once a line."""
    tree = parse(program.source)
    found = {(line, what): instead for line, what, instead in _uses(tree, language)}
    return [(line, what, found[line, what]) for line, what in sorted(found)]


def _catches_import_errors(tree: ast.AST) -> bool:
    """Whether an import stands in a ``try``."""
    tries = [node for node in ast.walk(tree) if isinstance(node, ast.Try)]
    return any(
        isinstance(inner, ast.Import | ast.ImportFrom) for node in tries for inner in node.body
    )


def _imported(tree: ast.AST) -> Iterator[str]:
    """Modules that are imported, and each name of one as ``module.name``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            for alias in node.names:
                yield f"{node.module}.{alias.name}"


def _aliases(tree: ast.AST) -> dict[str, str]:
    """Names that imports give to things, and the own names of these: ``import motor as m``."""
    aliases = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            for alias in node.names:
                if alias.asname:
                    aliases[alias.asname] = alias.name
    return aliases


def _hub_parts(tree: ast.AST) -> Iterator[str]:
    """Parts of the module ``hub`` that a program uses by its name, such as ``hub.light``."""
    # The hub of another program is an object, which it has not imported.
    if "hub" not in _imported(tree):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{node.value.id}.{node.attr}"


def _uses(tree: ast.AST, language: Language) -> Iterator[tuple[int, str, str]]:
    aliases = _aliases(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            owner = node.value
            before = getattr(owner, "attr", getattr(owner, "id", ""))
            before = aliases.get(before, before)
            # The longer name says more: `motor.run` is another thing than `run` of a motor.
            for name in (f"{before}.{node.attr}", node.attr):
                if name in language.uses:
                    yield node.lineno, name, language.uses[name]
                    break
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            name = aliases.get(node.func.id, node.func.id)
            if name in language.uses:
                yield node.lineno, name, language.uses[name]
        elif isinstance(node, ast.ImportFrom | ast.Import):
            yield from _of_import(node, language)


def _of_import(
    node: ast.Import | ast.ImportFrom,
    language: Language,
) -> Iterator[tuple[int, str, str]]:
    module = getattr(node, "module", None)
    for alias in node.names:
        name = alias.name
        full = f"{module}.{name}" if module else name
        # What is only imported, and not called where it is used, is told here.
        if name in language.uses and (module or "." not in name):
            yield node.lineno, name, language.uses[name]
        elif full in language.uses:
            yield node.lineno, full, language.uses[full]
