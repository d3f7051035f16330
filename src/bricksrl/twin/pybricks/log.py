"""``Motor.log`` and the ``log`` of controllers (``pb_type_logger.c``, v4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bricksrl.twin.firmware.logger import Logger
from bricksrl.twin.machine import CONTROL_LOOP_MS
from bricksrl.twin.pybricks.context import Context, charged, get_int


class Log:
    """Notes down the state of each control loop, and prints it as a file that pybricksdev saves."""

    def __init__(self, logger: Callable[[], Logger], context: Context) -> None:
        self._logger = logger
        self._machine = context.machine
        self._console = context.console

    @charged
    def start(self, duration: Any, down_sample: Any = 1) -> None:
        every = max(get_int(down_sample), 1)
        duration_ms = get_int(duration)
        if duration_ms < 0:
            raise MemoryError("memory allocation failed")
        self._logger().start(self._machine.time_ms, duration_ms // CONTROL_LOOP_MS // every, every)

    @charged
    def stop(self) -> None:
        self._logger().stop()

    @charged
    def save(self, path: Any = None) -> None:
        logger = self._logger()
        logger.stop()
        if path is not None and not isinstance(path, str):
            raise TypeError(f"can't convert '{type(path).__name__}' object to str implicitly")
        self._print(f"PB_OF:{path or 'log.txt'}")
        for row in logger.rows:
            self._print(", ".join(map(str, row)))
        self._print("PB_EOF")

    def _print(self, line: str) -> None:
        self._console.write(f"{line}\r\n".encode())
