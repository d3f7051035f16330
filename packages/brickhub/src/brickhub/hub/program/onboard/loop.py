"""MicroPython: the loop on the hub, the same for every robot. ``generate.py`` appends it to the
robot-specific part.

Names in capitals that are not defined here, ``start_moves`` and ``read_channels`` are in the
robot-specific part; ``send`` and ``Reader`` in ``frames.py``; ``stop_motors`` and ``LOOK_MS`` in
``moves.py``; ``listen`` in ``stdio.py`` or ``app_data.py``.

A command is carried out once: when its sequence number is repeated, the answer is resent and
nothing moves. A new command replaces one in progress. READ answers at once, and the step in
progress is not answered then. After STREAM and a first command or READ the channels are sent
continuously, with the sequence number of the latest one; STREAM 0 ends it. In a frame the number
comes first; 0 marks one that controls the program and moves nothing.

Only frames from the host feed the watchdog, even during a step: after ``WATCHDOG_MS`` of silence
(or the time that the last WATCHDOG frame has set) the motors stop, or in a step the program ends;
after ``END_MS`` more it ends in any case.

What is above the line "the hub's part" stays on the computer. Changing what is below it changes
every program's hash, so that each hub downloads its program again.
"""
# mypy: ignore-errors
# ruff: noqa: F821
# --- the hub's part ---

import ustruct
from pybricks.tools import StopWatch


class Server:
    """What the hub remembers between two turns of the loop."""

    def __init__(self):
        self.clock = StopWatch()
        self.reader = Reader()
        self.watchdog_ms = WATCHDOG_MS
        self.heard_ms = 0  # time of the last valid frame
        self.armed = False  # motors may be running on the host's word
        self.moving = False
        self.started_ms = 0
        self.stream_ms = 0  # time between observations that are sent unasked; 0 for none
        self.sent_ms = 0
        self.seq = 0  # last command, and its answer once there is one
        self.answer = b""

    def turn(self):
        """One turn of the loop. False ends the program."""
        frame = self.reader.frame(self.patience_ms())
        now = self.clock.time()
        if frame:
            self.heard_ms = now
            if frame[1]:
                self.command(frame[1], frame[2:-1])
                return True
            return self.control(frame[2], frame[3:-1])
        silent_ms = now - self.heard_ms + 1  # at most: the clock tells whole milliseconds
        if self.armed and silent_ms >= self.watchdog_ms:
            if self.moving:  # an answer would look like that of a whole step
                self.bye(SILENCE)
                return False
            self.disarm()
        if self.moving:
            if self.settled(now - self.started_ms):
                self.moving = False
                self.observe()
            return True
        if self.streams() and now - self.sent_ms >= self.stream_ms:
            self.sent_ms = max(self.sent_ms + self.stream_ms, now - self.stream_ms)
            self.observe()
        if silent_ms >= self.watchdog_ms + END_MS:
            self.bye(SILENCE)
            return False
        return True

    def patience_ms(self):
        """How long nothing but a frame matters."""
        now = self.clock.time()
        until = self.heard_ms + self.watchdog_ms - 1 + (0 if self.armed else END_MS)
        if self.streams():
            until = min(until, self.sent_ms + self.stream_ms)
        elif self.moving:
            until = min(until, self.started_ms + SETTLE_MS, now + LOOK_MS if UNTIL_DONE else until)
        return max(0, until - now)

    def command(self, seq, payload):
        if seq != self.seq:
            self.seq = seq
            self.answer = b""
            self.armed = True
            self.moving = not self.stream_ms
            self.started_ms = self.clock.time()
            start_moves(ustruct.unpack(ACTION_FORMAT, payload))
        elif self.answer and not self.stream_ms:
            send(self.answer)

    def control(self, kind, payload):
        if kind == STOP:
            self.bye(STOPPED)
            return False
        if kind == HELLO:  # a new session: its sequence numbers start afresh
            self.disarm()
            self.seq = 0
            self.stream_ms = 0
            send(HELLO_HEAD + PROGRAM_HASH)
        elif kind == READ:
            self.seq = payload[0]
            self.moving = False
            self.observe()
        elif kind == WATCHDOG:
            self.watchdog_ms = ustruct.unpack("<H", payload)[0]
        elif kind == STREAM:
            self.stream_ms = ustruct.unpack("<H", payload)[0]
        return True

    def settled(self, elapsed_ms):
        """Whether it is time to answer. A move that is still blocked then is stopped."""
        if UNTIL_DONE:
            moving = [mover for mover in MOVERS if not mover.done()]
            if not moving:
                return True
            if elapsed_ms >= SETTLE_MS:
                for mover in moving:
                    mover.stop()
        return elapsed_ms >= SETTLE_MS

    def streams(self):
        return self.stream_ms and self.seq

    def observe(self):
        self.answer = bytes([MAGIC, self.seq]) + read_channels(self.clock.time() & 0xFFFF)
        send(self.answer)

    def disarm(self):
        stop_motors()
        self.armed = False
        self.moving = False

    def bye(self, reason):
        self.disarm()
        send(BYE_HEAD + bytes([reason]))


def serve():
    """Answer the host until it says stop or has been silent for too long."""
    listen()
    server = Server()
    send(HELLO_HEAD + PROGRAM_HASH)
    try:
        while server.turn():
            pass
    finally:
        stop_motors()


serve()
