"""Browsers as plain programs, without a driver: a page of the tests tells the test what it found,
by posting it to the file server that it came from."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NAMES = ("chromium", "firefox", "webkit")
_END_S = 20.0


def _command(name: str, profile: Path) -> list[str]:
    """Words that start a browser with a profile of its own; none if it is not there."""
    if name == "chromium":
        found = shutil.which("chromium") or shutil.which("google-chrome")
        words = ["--headless", "--no-sandbox", "--no-first-run", f"--user-data-dir={profile}"]
        return [found, *words] if found else []
    if name == "firefox":
        found = shutil.which("firefox-esr") or shutil.which("firefox")
        words = ["--headless", "--no-remote", "--profile", str(profile)]
        return [found, *words] if found else []
    screen = shutil.which("xvfb-run")
    # WebKitGTK's own browser for trials, which its driver starts too.
    browsers = sorted(Path("/usr/lib").glob("*/webkit2gtk-4*/MiniBrowser"))
    return [screen, "-a", str(browsers[-1])] if screen and browsers else []


@contextmanager
def opened(name: str, address: str, profile: Path) -> Iterator[None]:
    """A browser with a page open. Skips where the browser is not on this computer."""
    command = _command(name, profile)
    if not command:
        pytest.skip(f"{name} is not on this computer")
    profile.mkdir(parents=True)
    # Whatever it keeps, it keeps in its profile.
    places = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")
    process = subprocess.Popen(
        [*command, address],
        env={**os.environ, **dict.fromkeys(places, str(profile))},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield
    finally:
        # Browsers are many processes, which are a group here.
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
