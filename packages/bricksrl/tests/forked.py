"""Commands in processes that are forked from one that has imported torch, TorchRL and MuJoCo, which costs four seconds.

Each command has a process, standard streams, an environment and an exit code of its own, as from a shell.
"""

from __future__ import annotations

import array
import atexit
import gc
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

IMPORTED = ("torch", "torchrl.data", "torchrl.envs", "mujoco", "bricksrl.cli.app", "bricksrl.training.run", "bricksrl.evaluation")


class ForkServer:
    """Server that runs commands of ``bricksrl``, one after the other."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, __file__, str(theirs.fileno())]
            environment = {**os.environ, "MUJOCO_GL": "disable"}
            self._server = subprocess.Popen(command, pass_fds=(theirs.fileno(),), env=environment, stdin=subprocess.DEVNULL)
        self._socket, self._lock = ours, threading.Lock()

    def run(
        self, arguments: Sequence[str], folder: Path, environment: Mapping[str, str], timeout_s: float, script: str = ""
    ) -> subprocess.CompletedProcess[str]:
        """Run a command, or a script, to its end. Raises TimeoutExpired, and kills it, after ``timeout_s``."""
        asked = {"arguments": list(arguments), "folder": str(folder), "environment": dict(environment), "script": script}
        with self._lock:
            return self._run(json.dumps(asked).encode(), arguments, timeout_s)

    def _run(self, request: bytes, arguments: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            self._socket.settimeout(60)
            self._socket.sendall(len(request).to_bytes(4, "little") + request)
            socket.send_fds(self._socket, [b"."], [out.fileno(), err.fileno()])
            pid = int.from_bytes(_exactly(self._socket, 4), "little")
            self._socket.settimeout(timeout_s)
            try:
                code = int.from_bytes(_exactly(self._socket, 4), "little", signed=True)
            except TimeoutError:
                os.kill(pid, signal.SIGKILL)
                self._socket.settimeout(60)
                _exactly(self._socket, 4)
                err.seek(0)
                said = err.read().decode()
                raise subprocess.TimeoutExpired(f"bricksrl {' '.join(arguments)}, which said {said!r}", timeout_s) from None
            texts = []
            for file in (out, err):
                file.seek(0)
                texts.append(file.read().decode())
        return subprocess.CompletedProcess(["bricksrl", *arguments], code, *texts)

    def close(self) -> None:
        """End the server."""
        self._socket.close()
        self._server.wait(30)


def _exactly(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        part = connection.recv(size - len(data))
        if not part:
            raise EOFError
        data += part
    return data


def serve(connection: socket.socket) -> int:
    """Run the commands that the other side asks for, until it leaves."""
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # what is imported is not looked at, and so not copied, by the commands
    while True:
        try:
            request: dict[str, Any] = json.loads(_exactly(connection, int.from_bytes(_exactly(connection, 4), "little")))
        except EOFError:
            return 0
        _, fds, _, _ = socket.recv_fds(connection, 1, 2)
        pid = os.fork()
        if pid == 0:
            connection.close()
            end(command(request, fds))
        for fd in fds:
            os.close(fd)
        connection.sendall(pid.to_bytes(4, "little"))
        _, status = os.waitpid(pid, 0)
        connection.sendall(os.waitstatus_to_exitcode(status).to_bytes(4, "little", signed=True))


def end(code: int) -> NoReturn:
    """End the process of a command in order, but for the seconds in which the interpreter takes torch apart."""
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def command(request: dict[str, Any], fds: Sequence[int] | array.array[int]) -> int:
    """Run one command or script in this process, on these standard streams."""
    from bricksrl.cli import main

    for fd, standard in zip(fds, (1, 2), strict=True):
        os.dup2(fd, standard)
        os.close(fd)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = ["bricksrl", *request["arguments"]]
    if request["script"]:
        exec(request["script"], {"__name__": "__main__"})  # noqa: S102
        sys.exit()  # as a script ends
    try:
        return main(request["arguments"])
    except SystemExit as ended:
        if isinstance(ended.code, str):
            raise
        return ended.code or 0


if __name__ == "__main__":
    sys.exit(serve(socket.socket(fileno=int(sys.argv[1]))))
