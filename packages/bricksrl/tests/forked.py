"""Processes that are forked from one that has imported torch, TorchRL and MuJoCo, which costs four
seconds.

Each has standard streams, an environment, a folder and an exit code of its own, as one that is
started from a shell.
"""

from __future__ import annotations

import array
import atexit
import contextlib
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

CAN_FORK = sys.platform == "linux"
"""Whether it is safe: libraries of macOS have threads and states that do not outlive a fork."""
IMPORTED = (
    "torch",
    "torchrl.data",
    "torchrl.envs",
    "mujoco",
    "matplotlib.backends.backend_agg",
    "matplotlib.pyplot",
    "pandas",  # TensorDict and PyArrow ask for it
    "pyarrow.parquet",
    "scipy.stats",
    "brickhub.kits.virtual_kit",
    "bricktwin.twin.models.kept_models",
    "bricktwin.twin.mujoco_body",
    "bricksrl.cli.app",
    "bricksrl.cli.evaluate",
    "bricksrl.cli.train",
    "bricksrl.envs.env",
    "bricksrl.envs.own_env",
    "bricksrl.evaluation",
    "bricksrl.training.fleet.worker",
    "bricksrl.training.learner_side",
    "bricksrl.training.loop",
    "bricksrl.training.run",
)
"""What the commands would import each by itself, for two seconds of CPU time more."""


class Forked(subprocess.Popen[Any]):
    """A process of the server, which waits for its end in our place."""

    def __init__(
        self, args: Sequence[str], pid: int, status: int, streams: Sequence[Any], *, is_text: bool
    ) -> None:
        self.args, self.pid, self.returncode, self.text_mode = args, pid, None, is_text
        self.stdin, self.stdout, self.stderr = streams
        self.encoding = self.errors = self._input = None
        self._communication_started, self._child_created, self._waitpid_lock = (
            False,
            True,
            threading.Lock(),
        )
        self._status: int = status

    def _internal_poll(self, *_: Any, **__: Any) -> int | None:
        if self.returncode is None and select.select([self._status], [], [], 0)[0]:
            self._wait(None)
        return self.returncode

    def _wait(self, timeout: float | None) -> int:
        with self._waitpid_lock:
            if self.returncode is None:
                if not select.select([self._status], [], [], timeout)[0]:
                    raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
                self.returncode = int.from_bytes(os.read(self._status, 4), "little", signed=True)
                os.close(self._status)
        return self.returncode


class ForkServer:
    """Server that starts commands of ``bricksrl``, scripts and modules."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        self._folder = tempfile.TemporaryDirectory()
        self.path = str(Path(self._folder.name) / "server")
        with theirs:
            command = [sys.executable, __file__, str(theirs.fileno()), self.path]
            environment = {**os.environ, "MUJOCO_GL": "disable"}
            self._server = subprocess.Popen(
                command, pass_fds=(theirs.fileno(),), env=environment, stdin=subprocess.DEVNULL
            )
        self._socket = ours
        self._socket.settimeout(60)
        # One thread has all exchanges with the server, and no Ctrl-C of a test falls into one: else
        # its answer would be taken for that of the next one.
        self._exchanges = ThreadPoolExecutor(1, "fork-server")
        self.forks_children = False
        """Whether processes that a command starts for learning or for a robot are forked, too."""

    def start(
        self,
        arguments: Sequence[str],
        streams: Sequence[Any],
        *,
        is_text: bool = True,
        **asked: Any,
    ) -> Forked:
        """Start a process. ``streams``: standard input, output and error: a file,
        ``subprocess.PIPE``, or ``None`` for ours. ``asked``: its folder and environment, and a
        script or a module in place of a command."""
        ends: list[tuple[int, Any]] = []
        for number, stream in enumerate(streams):
            if stream == subprocess.PIPE:
                read, write = os.pipe()
                theirs, own, mode = (read, write, "w") if number == 0 else (write, read, "r")
                ends.append((theirs, os.fdopen(own, mode if is_text else f"{mode}b")))
            else:
                ends.append((os.dup(number if stream is None else stream.fileno()), None))
        status, told = os.pipe()
        request = json.dumps(
            {
                "arguments": list(arguments),
                "folder": str(Path.cwd()),
                "server": self.path if self.forks_children else "",
                **asked,
            }
        ).encode()
        theirs_and_told = [*(end for end, _ in ends), told]
        pid = self._exchanges.submit(self._exchange, request, theirs_and_told).result()
        return Forked(
            ["bricksrl", *arguments], pid, status, [own for _, own in ends], is_text=is_text
        )

    def _exchange(self, request: bytes, fds: Sequence[int]) -> int:
        """Let the server start a process with these file descriptors; its number."""
        try:
            self._socket.sendall(len(request).to_bytes(4, "little") + request)
            socket.send_fds(self._socket, [b"."], fds)
            return int.from_bytes(_exactly(self._socket, 4), "little")
        finally:
            for fd in fds:
                os.close(fd)

    def run(
        self,
        arguments: Sequence[str],
        folder: Path,
        environment: Mapping[str, str],
        timeout_s: float,
        script: str = "",
    ) -> subprocess.CompletedProcess[str]:
        """Run a command, or a script, to its end. Raises TimeoutExpired, and kills it, after
        ``timeout_s``."""
        with (
            tempfile.TemporaryFile() as out,
            tempfile.TemporaryFile() as err,
            Path(os.devnull).open() as nothing,
        ):
            process = self.start(
                arguments,
                (nothing, out, err),
                folder=str(folder),
                environment=dict(environment),
                script=script,
            )
            try:
                code = process.wait(timeout_s)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(60)
                err.seek(0)
                said = err.read().decode()
                raise subprocess.TimeoutExpired(
                    f"bricksrl {' '.join(arguments)}, which said {said!r}", timeout_s
                ) from None
            texts = []
            for file in (out, err):
                file.seek(0)
                texts.append(file.read().decode())
        return subprocess.CompletedProcess(["bricksrl", *arguments], code, *texts)

    def popen(
        self, command: Sequence[str], *, stdin: Any, stdout: Any, env: Mapping[str, str], **_: Any
    ) -> Forked:
        """Start ``python -m MODULE`` as `bricksrl.child_process` does, in a session of its own."""
        return self.start(
            (), (stdin, stdout, None), is_text=False, environment=dict(env), module=command[-1]
        )

    def close(self) -> None:
        """End the server."""
        self._exchanges.shutdown()
        self._socket.close()
        self._server.wait(30)
        self._folder.cleanup()


class Scratch:
    """Processes from scratch, where there is no safe fork."""

    def start(
        self,
        arguments: Sequence[str],
        streams: Sequence[Any],
        *,
        folder: str = ".",
        environment: Mapping[str, str] | None = None,
        script: str = "",
    ) -> subprocess.Popen[str]:
        """As `ForkServer.start`."""
        stdin, stdout, stderr = streams
        return subprocess.Popen(
            _from_scratch(arguments, script),
            stdin=stdin,
            stdout=stdout,
            stderr=stderr,
            cwd=folder,
            env=environment,
            text=True,
        )

    def run(
        self,
        arguments: Sequence[str],
        folder: Path,
        environment: Mapping[str, str],
        timeout_s: float,
        script: str = "",
    ) -> subprocess.CompletedProcess[str]:
        """As `ForkServer.run`."""
        return subprocess.run(
            _from_scratch(arguments, script),
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )


def _from_scratch(arguments: Sequence[str], script: str) -> list[str]:
    return [sys.executable, *(["-c", script] if script else ["-m", "bricksrl"]), *arguments]


class ServerOfOthers(ForkServer):
    """A server that another process has started, at a path."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.forks_children = False
        self._exchanges = ThreadPoolExecutor(1, "fork-server")
        self._socket = _connected(path)

    def close(self) -> None:
        """Leave the server to the others."""
        self._exchanges.shutdown()
        self._socket.close()


def _connected(path: str) -> socket.socket:
    """A connection to a server that may still be importing."""
    until_s = time.monotonic() + 120.0
    while True:
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(60)
        try:
            connection.connect(path)
        except (FileNotFoundError, ConnectionRefusedError):
            connection.close()
            if time.monotonic() > until_s:
                raise
            time.sleep(0.1)
        else:
            return connection


def children_of(server: ForkServer) -> SimpleNamespace:
    """In place of the module `subprocess` in `bricksrl.child_process`."""
    return SimpleNamespace(
        Popen=server.popen, PIPE=subprocess.PIPE, TimeoutExpired=subprocess.TimeoutExpired
    )


def _exactly(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        part = connection.recv(size - len(data))
        if not part:
            raise EOFError
        data += part
    return data


def serve(connection: socket.socket, path: str) -> int:
    """Start the processes that the other side asks for, and tell of their ends, until it leaves."""
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # what is imported is not looked at, and so not copied, by the processes
    ended, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    told: dict[int, int] = {}
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(path)
    listener.listen()
    askers = [connection]
    while True:
        ready = select.select([*askers, listener, ended], [], [])[0]
        if ended in ready:
            os.read(ended, 4096)
            _tell_ends(told)
        if listener in ready:
            askers.append(listener.accept()[0])
        for asker in [asker for asker in askers if asker in ready]:
            try:
                request: dict[str, Any] = json.loads(
                    _exactly(asker, int.from_bytes(_exactly(asker, 4), "little"))
                )
                fds = list(socket.recv_fds(asker, 1, 4)[1])
            except (EOFError, OSError):
                if asker is connection:
                    return 0
                askers.remove(asker)
                asker.close()
                continue
            pid = os.fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                sockets = [each.detach() for each in (*askers, listener)]
                for fd in (*sockets, ended, wake, *told.values(), fds.pop()):
                    os.close(fd)
                end(command(request, fds))
            told[pid] = fds.pop()
            for fd in fds:
                os.close(fd)
            with contextlib.suppress(OSError):  # who asked has been killed
                asker.sendall(pid.to_bytes(4, "little"))


def _tell_ends(told: dict[int, int]) -> None:
    """Write the exit codes of the processes that have ended."""
    while told:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            return
        fd = told.pop(pid)
        with contextlib.suppress(BrokenPipeError):  # nobody asks
            os.write(fd, os.waitstatus_to_exitcode(status).to_bytes(4, "little", signed=True))
        os.close(fd)


def end(code: int) -> NoReturn:
    """End the process of a command in order, but for the seconds in which the interpreter takes
    torch apart."""
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def command(request: dict[str, Any], fds: Sequence[int] | array.array[int]) -> int:
    """Run one command, script or module in this process, on these standard streams."""
    from bricksrl import child_process
    from bricksrl.cli import main

    for number, fd in enumerate(fds):
        os.dup2(fd, number)
        os.close(fd)
    sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", 1, errors="backslashreplace", closefd=False)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = ["bricksrl", *request["arguments"]]
    if server := request["server"]:
        same = ServerOfOthers(server)
        same.forks_children = True
        child_process.subprocess = children_of(same)  # type: ignore[attr-defined]
    try:
        if module := request.get("module"):
            os.setsid()
            code: int | None = importlib.import_module(module).main()
            return code or 0
        if script := request.get("script"):
            exec(script, {"__name__": "__main__"})  # noqa: S102
            sys.exit()  # as a script ends
        return main()  # whose arguments are those of the process
    except SystemExit as ended:
        if isinstance(ended.code, str):
            raise
        return ended.code or 0


if __name__ == "__main__":
    sys.exit(serve(socket.socket(fileno=int(sys.argv[1])), sys.argv[2]))
