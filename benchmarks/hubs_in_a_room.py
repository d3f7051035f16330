"""Several hubs in one room: how much faster than real time they run.

    python -m benchmarks hubs_in_a_room

Each hub lies on a bench, turns a motor, broadcasts and observes every 20 ms, for 30 simulated
seconds. CPU time of this process; the median of ``--rounds`` rounds, the numbers of hubs taking
turns.
"""

from __future__ import annotations

import io
import statistics
import tempfile
import time
from pathlib import Path

from benchmarks.session import Session
from brickhub.virtual.room import HubProgramFile, Room

SECONDS = 30
PROGRAM = f"""
from pybricks.messaging import BLERadio
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import StopWatch, wait
radio, motor, watch = BLERadio(1, [1]), Motor(Port.A), StopWatch()
while watch.time() < {1000 * SECONDS}:
    radio.broadcast((watch.time(), 1.5))
    radio.observe(1)
    motor.run(300)
    wait(20)
"""


def cpu_s(hubs: int, path: Path) -> float:
    """CPU time of a room with so many hubs."""
    programs = [HubProgramFile(path)] * hubs
    begin_s = time.process_time()
    codes = Room(programs, stdout=io.BytesIO(), stderr=io.StringIO()).run()
    assert codes == [0] * hubs
    return time.process_time() - begin_s


def main(session: Session) -> int:
    """Measure and write."""
    args = session.parse(rounds=5, hubs=[1, 2, 3, 6])
    times_s: dict[int, list[float]] = {hubs: [] for hubs in args.hubs}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "main.py"
        path.write_text(PROGRAM)
        for _ in range(args.rounds):
            for hubs in args.hubs:
                times_s[hubs].append(cpu_s(hubs, path))
    rows = {
        str(hubs): {
            "cpu_s": round(statistics.median(measured_s), 3),
            "times_real_time": round(SECONDS / statistics.median(measured_s), 1),
        }
        for hubs, measured_s in times_s.items()
    }
    print(rows)
    session.write({"simulated_s": SECONDS, "hubs": rows})
    return 0
