// Harness of `python -m benchmarks firmware_ev3`: gives commands to the firmware's motor control, as
// MicroPython would, and shows the clock and the angles of both motors.
//
// Arguments: directions of the two motors (1 or -1), and the kind of the first one (L or M). Each
// line of the input is a command; one that moves waits for its end.

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pbdrv/clock.h>
#include <pbdrv/ioport.h>
#include <pbio/drivebase.h>
#include <pbio/main.h>
#include <pbio/os.h>
#include <pbio/port_interface.h>
#include <pbio/servo.h>

extern void pbdrv_motor_driver_init(void);

static pbio_servo_t *servos[2];
static pbio_drivebase_t *base;

// Ports of a computer have no pins.
pbio_error_t pbdrv_ioport_p5p6_set_mode(const pbdrv_ioport_pins_t *pins, pbdrv_ioport_p5p6_mode_t mode) {
    return PBIO_SUCCESS;
}

static void check(pbio_error_t error) {
    if (error != PBIO_SUCCESS) {
        printf("%d\n", error);
        exit(1);
    }
}

// One millisecond: what is due in this one, then the clock goes on, and the program with it.
static void step(void) {
    pbio_os_run_processes_and_wait_for_event();
}

static pbio_control_on_completion_t then_of(const char *name) {
    static const struct {
        const char *name;
        pbio_control_on_completion_t then;
    } all[] = {
        { "COAST", PBIO_CONTROL_ON_COMPLETION_COAST },
        { "BRAKE", PBIO_CONTROL_ON_COMPLETION_BRAKE },
        { "HOLD", PBIO_CONTROL_ON_COMPLETION_HOLD },
        { "NONE", PBIO_CONTROL_ON_COMPLETION_CONTINUE },
        { "COAST_SMART", PBIO_CONTROL_ON_COMPLETION_COAST_SMART },
        { "BRAKE_SMART", PBIO_CONTROL_ON_COMPLETION_BRAKE_SMART },
    };
    for (size_t i = 0; i < sizeof(all) / sizeof(all[0]); i++) {
        if (strcmp(all[i].name, name) == 0) {
            return all[i].then;
        }
    }
    exit(2);
}

static void set_up(int index, pbio_port_id_t port_id, int direction) {
    pbio_port_t *port;
    lego_device_type_id_t kind = LEGO_DEVICE_TYPE_ID_ANY_ENCODED_MOTOR;
    check(pbio_port_get_port(port_id, &port));
    check(pbio_port_get_servo(port, &kind, &servos[index]));
    pbio_direction_t sense = direction < 0 ? PBIO_DIRECTION_COUNTERCLOCKWISE : PBIO_DIRECTION_CLOCKWISE;
    check(pbio_servo_setup(servos[index], kind, sense, 1000, true, 0));
}

static void show(void) {
    int32_t angles[2], speed;
    for (int i = 0; i < 2; i++) {
        check(pbio_servo_get_state_user(servos[i], &angles[i], &speed));
    }
    // The program begins in the second millisecond.
    printf("%d %d %d\n", (int)pbdrv_clock_get_ms() - 1, (int)angles[0], (int)angles[1]);
}

static void run_motor(const char *command, const char *line) {
    int index = 0, a = 0, b = 0;
    char then[32] = "HOLD";
    sscanf(line, "%*s %d %d %d %31s", &index, &a, &b, then);
    pbio_servo_t *servo = servos[index];
    if (strcmp(command, "mrun") == 0) {
        check(pbio_servo_run_forever(servo, a));
        return;
    }
    if (strcmp(command, "mstop") == 0) {
        check(pbio_servo_stop(servo, PBIO_CONTROL_ON_COMPLETION_COAST));
        return;
    }
    if (strcmp(command, "mbrake") == 0) {
        check(pbio_servo_stop(servo, PBIO_CONTROL_ON_COMPLETION_BRAKE));
        return;
    }
    if (strcmp(command, "mhold") == 0) {
        check(pbio_servo_stop(servo, PBIO_CONTROL_ON_COMPLETION_HOLD));
        return;
    }
    if (strcmp(command, "mtime") == 0) {
        check(pbio_servo_run_time(servo, a, b, then_of(then)));
    } else if (strcmp(command, "mangle") == 0) {
        check(pbio_servo_run_angle(servo, a, b, then_of(then)));
    } else {
        check(pbio_servo_run_target(servo, a, b, then_of(then)));
    }
    while (!pbio_control_is_done(&servo->control)) {
        step();
    }
}

static void run_base(const char *command, const char *line) {
    int a = 0, b = 0;
    char then[32] = "HOLD";
    sscanf(line, "%*s %d %d %31s", &a, &b, then);
    if (strcmp(command, "base") == 0) {
        check(pbio_drivebase_get_drivebase(&base, servos[0], servos[1], a, b));
        return;
    }
    if (strcmp(command, "bdrive") == 0) {
        check(pbio_drivebase_drive_forever(base, a, b));
        return;
    }
    if (strcmp(command, "bstop") == 0) {
        check(pbio_drivebase_stop(base, PBIO_CONTROL_ON_COMPLETION_COAST));
        return;
    }
    if (strcmp(command, "bstraight") == 0) {
        check(pbio_drivebase_drive_straight(base, a, then_of(then)));
    } else if (strcmp(command, "bturn") == 0) {
        check(pbio_drivebase_drive_turn(base, a, false, then_of(then)));
    } else {
        check(pbio_drivebase_drive_curve(base, a, b, then_of(then)));
    }
    while (!pbio_drivebase_is_done(base)) {
        step();
    }
}

int main(int argc, char **argv) {
    if (argc < 4) {
        return 2;
    }
    pbdrv_motor_driver_init();
    pbio_init();
    step();
    set_up(0, argv[3][0] == 'M' ? PBIO_PORT_ID_C : PBIO_PORT_ID_A, atoi(argv[1]));
    set_up(1, PBIO_PORT_ID_B, atoi(argv[2]));
    char line[200], command[32];
    while (fgets(line, sizeof(line), stdin)) {
        int time_ms = 0;
        if (sscanf(line, "%31s %d", command, &time_ms) < 1) {
            continue;
        }
        if (strcmp(command, "wait") == 0) {
            while (time_ms-- > 0) {
                step();
            }
        } else if (strcmp(command, "show") == 0) {
            show();
        } else if (command[0] == 'm') {
            run_motor(command, line);
        } else {
            run_base(command, line);
        }
    }
    return 0;
}
