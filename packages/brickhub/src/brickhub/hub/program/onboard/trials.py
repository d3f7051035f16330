"""MicroPython: the loop of a program that tries a structured policy, one trial at a time.

Names in capitals that are not defined here, ``start_moves``, ``observe``, ``packed`` and ``act_by``
are in the robot-specific part; ``relative`` in ``relative.py``; ``send`` and ``Reader`` in
``frames.py``; ``stop_motors`` and ``LOOK_MS`` in ``moves.py``; ``listen`` in ``stdio.py`` or
``app_data.py``.

A trial is asked for by data frames with its number as ``seq``, which carry its steps and a piece of
its numbers each. It begins when all pieces are there, acts by itself, and sends what it observed
before each step and after the last one, with its number and the time. Then the motors stop, and a
control frame tells how many observations there were. A trial is made once: while it goes on, its
repeated frames do nothing, and later they have its end told again. One that is older than the last
one is not made any more, and a newer one replaces one that goes on.

Within a trial the host may be silent: it lasts no longer than ``LONGEST_MS``, and ends at once when
the robot tilts beyond ``LIMITS``. Between trials motors stand, and after ``END_MS`` of silence the
program ends.
"""
# mypy: ignore-errors
# ruff: noqa: F821, B905
# --- the hub's part ---

import ustruct
from pybricks.tools import StopWatch


class Trials:
    """What the hub remembers between two turns of the loop."""

    def __init__(self):
        self.clock = StopWatch()
        self.reader = Reader()
        self.heard_ms = 0  # time of the last valid frame, or of the end of the last trial
        self.seq = 0  # the last trial
        self.asked = 0  # a trial that is being asked for, and the pieces of its numbers
        self.pieces = {}
        self.numbers = []
        self.moving = False
        self.begun_ms = 0
        self.started_ms = 0
        self.steps = 0  # that are left
        self.count = 0  # observations of the last trial
        self.first = ()  # the first of them

    def turn(self):
        """One turn of the loop. False ends the program."""
        frame = self.reader.frame(self.patience_ms())
        now = self.clock.time()
        if frame:
            self.heard_ms = now
            if frame[1]:
                self.ask(frame[1], frame[2:-1])
                return True
            return self.control(frame[2], frame[3:-1])
        if self.moving:
            if self.settled(now - self.started_ms):
                self.step()
            return True
        if now - self.heard_ms >= END_MS:
            self.bye(SILENCE)
            return False
        return True

    def patience_ms(self):
        """How long nothing but a frame matters."""
        now = self.clock.time()
        if not self.moving:
            return max(0, self.heard_ms + END_MS - now)
        left_ms = max(0, self.started_ms + SETTLE_MS - now)
        return min(left_ms, LOOK_MS) if UNTIL_DONE else left_ms

    def ask(self, seq, payload):
        """Take a piece of a trial's numbers."""
        if seq == self.seq:
            if not self.moving:
                self.tell_end()
            return
        if self.seq and (seq - self.seq) % 255 > 127:
            return
        if seq != self.asked:
            self.asked = seq
            self.pieces = {}
        self.pieces[payload[1]] = ustruct.unpack(PIECE_FORMAT, payload[2:])
        if all(index in self.pieces for index in range(PIECES)):
            shares = []
            for index in range(PIECES):
                shares += self.pieces[index]
            self.begin(seq, payload[0], shares)

    def begin(self, seq, steps, shares):
        self.numbers = [middle + half * share for (middle, half), share in zip(RANGES, shares)]
        self.seq = seq
        self.steps = steps
        self.count = 0
        self.begun_ms = self.clock.time()
        self.step()

    def step(self):
        """Observe, and start the next step or end the trial."""
        observed = observe()
        now = self.clock.time()
        self.report(self.seq, now, observed)
        self.count += 1
        has_tilted = any(abs(observed[index]) > limit for index, limit in LIMITS)
        if has_tilted or not self.steps or now - self.begun_ms >= LONGEST_MS:
            self.end()
            return
        self.steps -= 1
        if self.count == 1:
            self.first = observed
        actions = act_by(relative(observed, self.first), self.numbers)
        self.started_ms = self.clock.time()
        self.moving = True
        start_moves(
            [round(middle + half * action) for (middle, half), action in zip(SPANS, actions)]
        )

    def settled(self, elapsed_ms):
        """Whether a step is over. A move that is still blocked then is stopped."""
        if elapsed_ms < SETTLE_MS:
            return UNTIL_DONE and all(mover.done() for mover in MOVERS)
        if UNTIL_DONE:
            for mover in MOVERS:
                if not mover.done():
                    mover.stop()
        return True

    def end(self):
        self.stand()
        self.heard_ms = self.clock.time()
        self.tell_end()

    def tell_end(self):
        send(END_HEAD + ustruct.pack("<BH", self.seq, self.count))

    def stand(self):
        stop_motors()
        self.moving = False

    def control(self, kind, payload):
        if kind == STOP:
            self.bye(STOPPED)
            return False
        if kind == HELLO:  # a new session: its trials are counted afresh
            self.stand()
            self.seq = 0
            self.asked = 0
            send(HELLO_HEAD + PROGRAM_HASH)
        elif kind == READ and not self.moving:
            self.report(payload[0], self.clock.time(), observe())
        return True

    def report(self, seq, now, observed):
        send(bytes([MAGIC, seq]) + packed(now & 0xFFFF, observed))

    def bye(self, reason):
        self.stand()
        send(BYE_HEAD + bytes([reason]))


def serve():
    """Make trials until the host says stop or has been silent for too long."""
    listen()
    trials = Trials()
    send(HELLO_HEAD + PROGRAM_HASH)
    try:
        while trials.turn():
            pass
    finally:
        stop_motors()


serve()
