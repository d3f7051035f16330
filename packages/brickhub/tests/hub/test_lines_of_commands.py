"""Each command's and channel's line of a hub program, its words, and its limits."""

from __future__ import annotations

from dataclasses import replace

import pytest
from described import TWO_WHEELER

from brickhub.errors import DescriptionError
from brickhub.hub.interface import (
    Channel,
    ClientChannel,
    ClientCommand,
    Command,
    Curve,
    Distance,
    DriveAngle,
    DriveDistance,
    DriveSpeed,
    DriveStraight,
    DriveTurnRate,
    Heading,
    HubButton,
    HubLight,
    HubSound,
    Interface,
    LightBrightness,
    MotorAngle,
    Pitch,
    PitchRate,
    RemoteButton,
    Roll,
    RunAngle,
    RunDuty,
    RunSpeed,
    SensorReading,
    TrackTarget,
    Turn,
    UntilDone,
    Wait,
    WatchedButton,
    WatchedRemoteButton,
    WheelsAngle,
    WheelsSpeed,
    YawRate,
)
from brickhub.robot import (
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)

ROBOT = Robot(
    "all",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B"), Motor("arm", "C", range_deg=(-30, 90))),
    (
        UltrasonicSensor("eyes", "D"),
        PoweredUpSensor("color", "E", SensorKind.COLOR),
        PoweredUpSensor("lamp", "F", SensorKind.LIGHT),
    ),
    DriveBase("left", "right", 56.0, 112.5),
    needs_imu=True,
)
TILTING = Robot(
    "tilting",
    HubKind.PRIME,
    sensors=(
        PoweredUpSensor("level", "A", SensorKind.TILT),
        PoweredUpSensor("button", "B", SensorKind.FORCE),
    ),
)
BRICK = Robot(
    "brick",
    HubKind.EV3,
    (Motor("left", "B", MotorKind.EV3_LARGE),),
    (
        PoweredUpSensor("gyro", "2", SensorKind.EV3_GYRO),
        PoweredUpSensor("far", "4", SensorKind.EV3_ULTRASONIC),
        PoweredUpSensor("near", "1", SensorKind.EV3_INFRARED),
    ),
)
AXIS = (("pybricks.parameters", "Axis"),)
BUTTON = (("pybricks.parameters", "Button"),)


@pytest.mark.parametrize(
    ("command", "line", "description"),
    [
        (
            RunAngle("left", -90, 45, 300),
            "motor_left.run_angle(300, X, wait=False)",
            "turn by -90 to 45 deg at 300 deg/s",
        ),
        (
            RunAngle("arm", -90, 45, 300),
            "motor_arm.turn(300, X)",
            "turn by -90 to 45 deg at 300 deg/s",
        ),
        (RunSpeed("left", -500, 400), "motor_left.run(X)", "run at -500 to 400 deg/s"),
        (
            RunDuty("left"),
            "motor_left.dc(X)",
            "run with -100 to 100 % of the battery's voltage",
        ),
        (TrackTarget("arm", 0, 45), "motor_arm.track_target(X)", "go to 0 to 45 deg"),
        (DriveStraight(-100, 50), "drive_base.straight(X, wait=False)", "drive -100 to 50 mm"),
        (Turn(-90, 80), "drive_base.turn(X, wait=False)", "turn by -90 to 80 deg"),
        (
            Curve(-90, 80, 100),
            "drive_base.curve(100, X, wait=False)",
            "drive along a circle of 100 mm by -90 to 80 deg",
        ),
        (DriveSpeed(-200, 100), "drive_base.drive(X, 0)", "drive at -200 to 100 mm/s"),
        (DriveTurnRate(-90, 60), "drive_base.drive(0, X)", "turn at -90 to 60 deg/s"),
        (
            HubLight(),
            "hub.light.on(Color(X, 100, 100))",
            "light of a hue of 0 to 359 deg",
        ),
        (HubSound(), "play_tone(X)", "a tone of 0 to 2000 Hz for 50 ms"),
        (LightBrightness("lamp"), "sensor_lamp.on(X)", "light with 0 to 100 %"),
        (LightBrightness("eyes"), "sensor_eyes.lights.on(X)", "light with 0 to 100 %"),
    ],
)
def test_line_and_words_of_a_command(command: Command, line: str, description: str) -> None:
    command.check(ROBOT)
    assert command.start(ROBOT, {command.name: "X"}) == line
    assert command.description.format(command) == description


def test_both_arguments_of_a_drive_are_one_call() -> None:
    amounts = {"turn_rate": "T", "drive_speed": "S"}
    for command in (DriveSpeed(-1, 1), DriveTurnRate(-1, 1)):
        assert command.call == "drive"
        assert command.start(ROBOT, amounts) == "drive_base.drive(S, T)"


@pytest.mark.parametrize(
    ("command", "name", "unit", "scale", "mover", "devices"),
    [
        (RunAngle("left", -1, 1, 9), "left", "deg", 10, "motor_left", ("left",)),
        (RunSpeed("left", -1, 1), "left", "deg/s", 10, "motor_left", ("left",)),
        (RunDuty("left"), "left", "%", 10, "motor_left", ("left",)),
        (TrackTarget("left", -1, 1), "left", "deg", 10, "motor_left", ("left",)),
        (DriveStraight(-1, 1), "straight", "mm", 10, "drive_base", ("left", "right")),
        (Turn(-1, 1), "turn", "deg", 10, "drive_base", ("left", "right")),
        (Curve(-1, 1, 50), "curve", "deg", 10, "drive_base", ("left", "right")),
        (DriveSpeed(-1, 1), "drive_speed", "mm/s", 10, "drive_base", ("left", "right")),
        (DriveTurnRate(-1, 1), "turn_rate", "deg/s", 10, "drive_base", ("left", "right")),
        (HubLight(), "light", "deg", 10, None, ()),
        (HubSound(), "sound", "Hz", 1, None, ()),
        (LightBrightness("lamp"), "lamp_brightness", "%", 10, None, ("lamp",)),
    ],
)
def test_what_a_command_is(
    command: Command,
    name: str,
    unit: str,
    scale: int,
    mover: str | None,
    devices: tuple[str, ...],
) -> None:
    assert (command.name, command.unit, command.scale) == (name, unit, scale)
    assert command.mover == mover
    assert command.devices(ROBOT) == devices
    entry = command.entry
    assert (entry.name, entry.low, entry.high, entry.unit) == (
        name,
        command.low,
        command.high,
        unit,
    )
    # Nothing but moves turns motors.
    assert command.motors(ROBOT) == (devices if mover else ())


def test_moves_that_end_by_themselves() -> None:
    ends = [RunAngle("left", -1, 1, 9), DriveStraight(-1, 1), Turn(-1, 1), Curve(-1, 1, 50)]
    goes_on = [RunSpeed("left", -1, 1), RunDuty("left"), TrackTarget("left", -1, 1)]
    goes_on += [DriveSpeed(-1, 1), DriveTurnRate(-1, 1)]
    assert all(command.ends for command in ends)
    assert not any(command.ends for command in goes_on)
    turned_by = [command for command in (*ends, *goes_on) if command.is_turn_by]
    assert turned_by == ends[:1]
    without_encoder = [command for command in (*ends, *goes_on) if not command.needs_encoder]
    assert without_encoder == [RunDuty("left")]


def test_drive_base_is_made_with_all_digits() -> None:
    line = "drive_base = DriveBase(motor_left, motor_right, wheel_diameter=56.0, axle_track=112.5)"
    for part in (DriveStraight(-1, 1), DriveSpeed(-1, 1), DriveDistance(-9, 9), DriveAngle(-9, 9)):
        assert part.setup(ROBOT) == (line,)
        assert part.imports == (("pybricks.robotics", "DriveBase"),)
    assert RunAngle("left", -1, 1, 9).setup(ROBOT) == ()
    assert Pitch().setup(ROBOT) == ()


def test_tone_is_silent_below_the_lowest() -> None:
    assert HubSound(duration_ms=80).setup(ROBOT) == (
        "def play_tone(frequency_hz):",
        "    if frequency_hz >= 64:",
        "        hub.speaker.beep(frequency_hz, 80)",
        "",
    )


ODD = Robot(
    "odd",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B", range_deg=(0, 90))),
    drive_base=DriveBase("left", "right", 56.0, 112.5),
)
CITY = Robot("city", HubKind.CITY, (Motor("left", "A"),))


@pytest.mark.parametrize(
    "command",
    [
        RunAngle("left", -1, 1, 1),
        RunAngle("left", -1, 1, 32_767),
        RunDuty("left", -100, 100),
        TrackTarget("arm", -30, 90),
        TrackTarget("left", -3000, 3000),
        Curve(-1, 1, 10),
        Curve(-1, 1, -10),
        Curve(-1, 1, 32_767),
        HubLight(0, 360),
        HubSound(0, 9, 1),
        HubSound(0, 9, 200),
        LightBrightness("lamp", 0, 100),
    ],
)
def test_command_at_its_limit_is_accepted(command: Command) -> None:
    command.check(ROBOT)


@pytest.mark.parametrize(
    ("command", "robot", "message"),
    [
        (RunAngle("left", -1, 1, 0), ROBOT, "speed 0 deg/s; give a positive one"),
        (RunAngle("left", -1, 1, 32_768), ROBOT, "speed 32768 deg/s; give a positive one"),
        (RunAngle("left", -1, 1, -9), ROBOT, "speed -9 deg/s; give a positive one"),
        (RunDuty("left", -101, 100), ROBOT, "ranges from -101 to 100 %; stay within -100 to 100"),
        (RunDuty("left", -100, 101), ROBOT, "ranges from -100 to 101 %; stay within -100 to 100"),
        (RunSpeed("arm", -9, 9), ROBOT, "turns endlessly, and motor 'arm' has a range"),
        (RunDuty("arm"), ROBOT, "turns endlessly, and motor 'arm' has a range"),
        (TrackTarget("arm", -31, 90), ROBOT, "beyond the motor's range of -30 to 90; stay within"),
        (TrackTarget("arm", -30, 91), ROBOT, "beyond the motor's range of -30 to 90; stay within"),
        (TrackTarget("arm", 45, 45), ROBOT, "ranges from 45 to 45 deg, beyond the motor's range"),
        (Curve(-1, 1, 9), ROBOT, "a radius of 9 mm; give 10 or more, or Turn on the spot"),
        (Curve(-1, 1, -9), ROBOT, "a radius of -9 mm; give 10 or more"),
        (Curve(-1, 1, 32_768), ROBOT, "a radius of 32768 mm; give 10 or more"),
        (Curve(-1, 1, 100), ODD, "motor 'right' of the drive base has a range; wheels turn"),
        (Turn(-1, 1), ODD, "motor 'right' of the drive base has a range; wheels turn"),
        (DriveSpeed(-1, 1), ODD, "motor 'right' of the drive base has a range; wheels turn"),
        (Turn(-1, 1), CITY, "robot 'city' has no drive base for 'turn'; describe one or command"),
        (HubLight(-1, 359), ROBOT, "ranges from -1 to 359; hues are 0 to 360 degrees"),
        (HubLight(0, 361), ROBOT, "ranges from 0 to 361; hues are 0 to 360 degrees"),
        (HubSound(-1, 9), ROBOT, "-1 Hz at least, for 50 ms; give 0 Hz or more, and 1 to 200 ms"),
        (HubSound(0, 9, 0), ROBOT, "0 Hz at least, for 0 ms; give 0 Hz or more, and 1 to 200 ms"),
        (HubSound(0, 9, 201), ROBOT, "0 Hz at least, for 201 ms; give 0 Hz or more"),
        (HubSound(), CITY, "a city hub has no loudspeaker; choose a prime hub, or use HubLight"),
        (LightBrightness("lamp", -1, 100), ROBOT, "ranges from -1 to 100 %; stay within 0 to 100"),
        (LightBrightness("lamp", 0, 101), ROBOT, "ranges from 0 to 101 %; stay within 0 to 100"),
        (LightBrightness("color"), ROBOT, "a ColorSensor has no light to set; use a Light or an"),
        (ClientCommand("push"), ROBOT, "is for a client of your own; name its program, or take"),
        (RunSpeed("leg", -1, 1), ROBOT, "robot 'all' has no motor 'leg'"),
    ],
)
def test_command_beyond_its_limit_is_refused(command: Command, robot: Robot, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        command.check(robot)


@pytest.mark.parametrize(
    ("channel", "name", "unit", "low", "high", "expression"),
    [
        (MotorAngle("left"), "left_angle", "deg", 0, 360, "motor_left.angle() % 360"),
        (MotorAngle("left", -90, 90), "left_angle", "deg", -90, 90, "motor_left.angle()"),
        (
            WheelsAngle("left", "right"),
            "wheels_angle",
            "deg",
            -360,
            360,
            "(motor_left.angle() + motor_right.angle()) / 2",
        ),
        (
            WheelsSpeed("left", "right"),
            "wheels_speed",
            "deg/s",
            -1000,
            1000,
            "(motor_left.speed() + motor_right.speed()) / 2",
        ),
        (Pitch(), "pitch", "deg", -90, 90, "pitch"),
        (Roll(), "roll", "deg", -90, 90, "roll"),
        (PitchRate(), "pitch_rate", "deg/s", -300, 300, "hub.imu.angular_velocity(Axis.Y)"),
        (YawRate(), "yaw_rate", "deg/s", -100, 100, "hub.imu.angular_velocity(Axis.Z)"),
        (YawRate(sensor="gyro"), "yaw_rate", "deg/s", -100, 100, "-sensor_gyro.speed()"),
        (Heading(), "heading", "deg", -180, 180, "hub.imu.heading()"),
        (Heading(sensor="gyro"), "heading", "deg", -180, 180, "sensor_gyro.angle()"),
        (DriveDistance(-9, 9), "drive_distance", "mm", -9, 9, "drive_base.distance()"),
        (DriveAngle(-9, 9), "drive_angle", "deg", -9, 9, "drive_base.angle()"),
        (Distance("eyes"), "distance", "mm", 0, 2000, "sensor_eyes.distance()"),
        (
            HubButton("left"),
            "hub_left",
            "",
            0,
            1,
            "int(Button.LEFT in hub.buttons.pressed())",
        ),
        (
            RemoteButton("left_plus"),
            "remote_left_plus",
            "",
            0,
            1,
            "int(Button.LEFT_PLUS in remote.buttons.pressed())",
        ),
        (
            SensorReading("color", "reflection", 0, 100, "%"),
            "color_reflection",
            "%",
            0,
            100,
            "sensor_color.reflection()",
        ),
        (
            SensorReading("color", "hsv", 0, 100, "%", part="saturation"),
            "color_saturation",
            "%",
            0,
            100,
            "read_color_hsv[1]",
        ),
        (
            SensorReading("level", "tilt", -45, 45, "deg", part="roll"),
            "level_roll",
            "deg",
            -45,
            45,
            "read_level_tilt[1]",
        ),
        (
            SensorReading("near", "rgb", 0, 100, "%", part="red"),
            "near_red",
            "%",
            0,
            100,
            "read_near_rgb[0]",
        ),
    ],
)
def test_what_a_channel_is(
    channel: Channel, name: str, unit: str, low: float, high: float, expression: str
) -> None:
    assert (channel.name, channel.unit) == (name, unit)
    assert (channel.low, channel.high) == (low, high)
    assert channel.expression == expression
    entry = channel.entry
    assert (entry.name, entry.low, entry.high, entry.unit) == (name, low, high, unit)
    assert entry.limits == channel.limits
    # Only an angle within a turn begins anew at its end.
    assert entry.wraps is channel.wraps is ((low, high, unit) == (0, 360, "deg"))


def test_what_is_read_once_for_several_channels() -> None:
    assert Pitch().statement == Roll().statement == "pitch, roll = hub.imu.tilt()"
    hue = SensorReading("color", "hsv", 0, 360, "deg", part="hue")
    assert hue.statement == "read_color_hsv = sensor_color.hsv()"
    alone = (SensorReading("color", "ambient", 0, 100), MotorAngle("left"), YawRate())
    assert [channel.statement for channel in alone] == [None, None, None]


@pytest.mark.parametrize(
    ("channel", "imports"),
    [
        (YawRate(), AXIS),
        (YawRate(sensor="gyro"), ()),
        (PitchRate(), AXIS),
        (Heading(), ()),
        (Pitch(), ()),
        (HubButton("left"), BUTTON),
        (RemoteButton("left"), (*BUTTON, ("pybricks.pupdevices", "Remote"))),
        (DriveAngle(-9, 9), (("pybricks.robotics", "DriveBase"),)),
    ],
)
def test_imports_of_a_channel(channel: Channel, imports: tuple[tuple[str, str], ...]) -> None:
    assert channel.imports == imports


WIDE = 2**31 - 1


@pytest.mark.parametrize(
    ("channel", "limits"),
    [
        # Wrapped or measured within a range: the range is all that there is.
        (MotorAngle("left"), None),
        (Pitch(), None),
        (Distance("eyes"), None),
        (HubButton("left"), None),
        (SensorReading("color", "ambient", 0, 100), None),
        # A rate may be faster than its range, up to 16 bits; what counts has 32.
        (YawRate(), 3276.7),
        (PitchRate(), 3276.7),
        (WheelsSpeed("left", "right"), 3276.7),
        (MotorAngle("left", -90, 90), WIDE / 10),
        (WheelsAngle("left", "right"), WIDE / 10),
        (Heading(), WIDE / 10),
        (DriveAngle(-9, 9), WIDE / 10),
        (DriveDistance(-9, 9), WIDE),
    ],
)
def test_possible_range_of_a_channel(channel: Channel, limits: float | None) -> None:
    assert channel.limits == (None if limits is None else (-limits, limits))


@pytest.mark.parametrize(
    ("channel", "is_wide"),
    [
        (MotorAngle("left"), False),
        (MotorAngle("left", -90, 90), True),
        (MotorAngle("arm", -30, 90), False),
        (Heading(), True),
        (DriveDistance(-9, 9), True),
        (WheelsAngle("left", "right"), True),
        (WheelsSpeed("left", "right"), False),
        (Pitch(), False),
    ],
)
def test_what_counts_without_end_has_32_bits(channel: Channel, is_wide: bool) -> None:
    assert channel.is_wide(ROBOT) is is_wide
    counts = channel.accumulates
    assert channel.is_wide(None) is counts


@pytest.mark.parametrize(
    ("channel", "devices"),
    [
        (MotorAngle("left"), ("left",)),
        (WheelsAngle("left", "right"), ("left", "right")),
        (DriveAngle(-9, 9), ("left", "right")),
        (Distance("eyes"), ("eyes",)),
        (SensorReading("color", "ambient", 0, 100), ("color",)),
        (YawRate(), ()),
        (YawRate(sensor="color"), ("color",)),
        (HubButton("left"), ()),
    ],
)
def test_devices_of_a_channel(channel: Channel, devices: tuple[str, ...]) -> None:
    assert channel.devices(ROBOT) == devices


@pytest.mark.parametrize(
    ("low", "high", "unit", "wraps"),
    [
        (0, 360, "deg", True),
        (0, 359, "deg", False),
        (1, 360, "deg", False),
        (0, 360, "%", False),
    ],
)
def test_only_a_whole_turn_of_degrees_wraps(
    low: float, high: float, unit: str, wraps: bool
) -> None:
    assert SensorReading("color", "hsv", low, high, unit, part="hue").wraps is wraps


@pytest.mark.parametrize("button", [WatchedButton("left"), WatchedRemoteButton("left")])
def test_watched_button_is_in_no_observation(button: HubButton) -> None:
    assert button.is_aside
    assert not HubButton("left").is_aside
    assert not RemoteButton("left").is_aside


def test_remote_takes_ten_seconds_at_most() -> None:
    assert RemoteButton("left").setup_s == 10.0
    assert RemoteButton("left").setup(ROBOT) == ("remote = Remote()",)
    assert RemoteButton("left").wireless == "remote"
    assert (HubButton("left").setup_s, HubButton("left").wireless) == (0.0, None)


@pytest.mark.parametrize(
    ("channel", "robot"),
    [
        (HubButton("left"), ROBOT),
        (HubButton("bluetooth"), ROBOT),
        (HubButton("center"), BRICK),
        (RemoteButton("center"), CITY),
        (SensorReading("level", "tilt", -9, 9, part="pitch"), TILTING),
        (SensorReading("button", "force", 0, 10), TILTING),
        (Distance("far"), BRICK),
        (Heading(sensor="gyro"), BRICK),
    ],
)
def test_channel_that_a_robot_has(channel: Channel, robot: Robot) -> None:
    channel.check(robot)


@pytest.mark.parametrize(
    ("channel", "robot", "message"),
    [
        (
            HubButton("center"),
            ROBOT,
            "'hub_center': the hub has no such button that a program may read; choose left, right,",
        ),
        (
            HubButton("left_up"),
            BRICK,
            "no such button that a program may read; choose center, left, right, up, down",
        ),
        (HubButton("left"), CITY, "may read; take a prime hub, or a RemoteButton"),
        (RemoteButton("up"), ROBOT, "the remote has no such button .* choose left_plus, left,"),
        (Pitch(), CITY, "'pitch' needs an IMU, which the city hub lacks; choose a prime,"),
        (YawRate(), BRICK, "'yaw_rate' needs an IMU, which the ev3 hub lacks"),
        (Heading(sensor="eyes"), ROBOT, "'eyes' is no GyroSensor; name one, or omit the sensor"),
        (Distance("color"), ROBOT, "'color' is not an UltrasonicSensor; use a SensorReading"),
        (
            SensorReading("eyes", "distance", 0, 2000),
            ROBOT,
            "'eyes' is an UltrasonicSensor; use Distance",
        ),
        (
            SensorReading("color", "reflexion", 0, 100),
            ROBOT,
            r"has no reading 'reflexion' \(did you mean 'reflection'\?\); it has reflection",
        ),
        (SensorReading("lamp", "on", 0, 100), ROBOT, "a Light has no reading 'on'; it has none"),
        (
            SensorReading("color", "ambient", 0, 100, part="hue"),
            ROBOT,
            r"ambient\(\) is one number; omit the part 'hue'",
        ),
        (
            SensorReading("level", "tilt", -9, 9),
            TILTING,
            r"tilt\(\) is 2 numbers; give as part one of pitch, roll",
        ),
        (DriveAngle(-9, 9), CITY, "robot 'city' has no drive base for 'drive_angle'"),
        (WheelsAngle("left", "tail"), ROBOT, "no motor 'tail'"),
        (WheelsSpeed("tail", "left"), ROBOT, "no motor 'tail'"),
        (MotorAngle("tail"), ROBOT, "no motor 'tail'"),
        (ClientChannel("x", 0, 1), ROBOT, "is of a client of your own; name its program, or take"),
    ],
)
def test_channel_that_a_robot_lacks(channel: Channel, robot: Robot, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        channel.check(robot)


def test_steps_have_a_time_or_a_limit() -> None:
    assert (Wait(250).fixed_ms, Wait(250).longest_ms) == (250, 250)
    assert (UntilDone().fixed_ms, UntilDone().longest_ms) == (None, 3000)
    assert UntilDone(500).longest_ms == 500


def test_places_of_angles_and_of_the_first_distance() -> None:
    channels = (Pitch(), MotorAngle("right"), Distance("eyes"), MotorAngle("left"), Distance("far"))
    interface = Interface((), channels, Wait(9))
    assert interface.angle_indices == {"right": 1, "left": 3}
    assert interface.distance_index == 2
    assert Interface((), channels[:2], Wait(9)).distance_index is None


def test_lists_of_parts_are_as_good_as_tuples() -> None:
    listed = Interface([HubLight()], [Pitch()], Wait(9))  # type: ignore[arg-type]
    assert listed == Interface((HubLight(),), (Pitch(),), Wait(9))
    assert hash(listed)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (RunSpeed("left", "slow", 9), "low of 'left' is 'slow'; give a number"),  # type: ignore[arg-type]
        (RunSpeed("left", -9, None), "high of 'left' is None; give a number"),  # type: ignore[arg-type]
    ],
)
def test_range_of_a_command_is_numbers(part: Command, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        Interface((part,), (), Wait(9))


def test_range_of_a_channel_is_numbers() -> None:
    with pytest.raises(DescriptionError, match="high of 'left_angle' is 'far'; give a number"):
        Interface((), (MotorAngle("left", 0, "far"),), Wait(9))  # type: ignore[arg-type]


def test_reading_of_a_mirrored_sensor_has_the_other_ones_name() -> None:
    sensors = (
        PoweredUpSensor("left_eye", "C", SensorKind.COLOR),
        PoweredUpSensor("right_eye", "D", SensorKind.COLOR),
    )
    robot = replace(TWO_WHEELER, sensors=sensors, mirrored=(("left_eye", "right_eye"),))
    hue = SensorReading("right_eye", "hsv", 0, 360, "deg", part="hue")
    assert hue.in_mirror(robot) == ("left_eye_hue", 1)
