"""Three visitors on one start page, each in a browser of its own: what each of them saw.

    python -m benchmarks visitors

Ada drives a robot, Ben drives the runner of Tag, Cy watches a Walker and comes to Ben's game. They
ask each other, reload, stop, and are cut off from a server that is frozen. The result is the
protocol: what was done, and every change of what each one saw. Needs Chromium; Linux only.
"""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser as Chromium
from playwright.sync_api import Page, sync_playwright

from benchmarks.endings import Command, is_free
from benchmarks.page_pictures import FLAGS
from benchmarks.session import Session
from brickhub.errors import BricksError

SIZES = {"Ada": (1280, 800), "Ben": (390, 844), "Cy": (844, 390)}
_TIMEOUT_MS, _LOOK_S = 120_000, 1.0
_SEEN = """() => {
  const text = (id) => {
    const box = document.getElementById(id);
    return box && !box.hidden ? box.textContent.trim() : "";
  };
  const all = (what) => [...document.querySelectorAll(what)].map((box) => box.innerText.replace(/\\s+/g, " ").trim());
  return {
    title: text("title") || "start page", state: text("state"), stop: text("stop-said"), note: text("note"),
    others: text("others"), message: text("message"),
    questions: all("#questions .question"), seats: all("#seats:not([hidden]) button"),
    driver: document.querySelector("#drive:not([hidden]) #driving:not([hidden]) #driver")?.textContent ?? "",
    jobs: all(".job:not(.over) > .row"),
  };
}"""  # noqa: E501


class Visit:
    """One visitor: a browser with one tab, and what it saw."""

    def __init__(self, name: str, browser: Chromium, url: str, protocol: Protocol) -> None:
        width, height = SIZES[name]
        self.name, self.url, self._protocol = name, url, protocol
        self._context = browser.new_context(viewport={"width": width, "height": height})
        self.page: Page = self._context.new_page()
        self.page.set_default_timeout(_TIMEOUT_MS)
        self.page.on("pageerror", lambda error: protocol.errors.append(f"{name}: {error}"))
        self.page.goto(url)
        self.page.get_by_label("Your name").fill(name)
        self.page.get_by_label("Your name").press("Enter")
        self._seen: dict[str, Any] = {}

    def look(self) -> None:
        """Note what has changed on the page."""
        try:
            seen = self.page.evaluate(_SEEN)
        except Exception as error:  # noqa: BLE001  between two pages
            seen = {"title": f"({type(error).__name__})"}
        changes = {key: value for key, value in seen.items() if value != self._seen.get(key, "")}
        if changes:
            self._protocol.write(self.name, sees=changes)
        self._seen = seen

    def does(self, what: str, act: Callable[[Page], object], shows: str = "") -> None:
        """Do something, and wait until the page shows a text."""
        self._protocol.write(self.name, does=what)
        act(self.page)
        if shows:
            limit_s = time.monotonic() + _TIMEOUT_MS / 1000
            while shows not in self.page.inner_text("body") and time.monotonic() < limit_s:
                self._protocol.wait(0.2)
            if shows not in self.page.inner_text("body"):
                raise BricksError(f"{self.name} does not see {shows!r} after: {what}")
        self.look()

    def takes_picture(self, folder: Path, name: str) -> None:
        """A picture of what is seen."""
        self.page.screenshot(path=folder / f"{name}.png")

    def leave(self) -> None:
        """Close all tabs."""
        self._protocol.write(self.name, does="closes all tabs")
        self._context.close()


class Protocol:
    """What was done and seen, in order, with the seconds since the start."""

    def __init__(self) -> None:
        self.lines: list[dict[str, Any]] = []
        self.errors: list[str] = []
        self.visits: list[Visit] = []
        self._start_s = time.monotonic()

    @property
    def now_s(self) -> float:
        """Seconds since the start."""
        return round(time.monotonic() - self._start_s, 1)

    def write(self, who: str, **what: Any) -> None:
        """Note something."""
        self.lines.append({"s": self.now_s, "who": who, **what})
        print(self.lines[-1], flush=True)

    def wait(self, duration_s: float) -> None:
        """Let time pass, and look at all pages meanwhile."""
        until_s = time.monotonic() + duration_s
        while True:
            for visit in self.visits:
                visit.look()
            left_s = until_s - time.monotonic()
            if left_s <= 0.0 or not self.visits:
                return
            self.visits[0].page.wait_for_timeout(1000 * min(_LOOK_S, left_s))


def button(name: str) -> Callable[[Page], object]:
    """A click on a button."""
    return lambda page: page.get_by_role("button", name=name, exact=True).click()


def card(env: str, name: str) -> Callable[[Page], object]:
    """A click on a button of an environment's card."""
    return lambda page: (
        page.get_by_label(env, exact=True).get_by_role("button", name=name, exact=True).click()
    )


def drives(page: Page, key: str = "ArrowUp") -> None:
    """Hold an arrow key for a while."""
    page.keyboard.down(key)
    page.wait_for_timeout(1500)
    page.keyboard.up(key)


def pid_of(command: Command, word: str) -> int:
    """The process of a job, by a word of its command."""
    for pid in command.processes():
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        if pid != command.pid and word.encode() in words:
            return pid
    raise BricksError(f"there is no process with {word}")


def story(command: Command, protocol: Protocol, pictures: Path, rest_s: float) -> None:
    """What the visitors do; they rest for so long between two scenes."""
    ada, ben, cy = protocol.visits
    ada.does("Drive on the card of Spinning-v0", card("Spinning-v0", "Drive"), "EMERGENCY STOP")
    ben.does(
        "Play together on the card of Tag-v0", card("Tag-v0", "Play together"), "Drive the runner"
    )
    cy.does("Play on the card of Walker-v1", card("Walker-v1", "Play"), "EMERGENCY STOP")
    protocol.wait(rest_s)
    ada.does("drives forward", drives)
    ben.does("Drive the runner", button("Drive the runner"))
    ben.does("drives forward", drives)
    protocol.wait(rest_s)

    cy.does(
        "goes back to the start page",
        lambda page: page.get_by_role("link", name="Start").click(),
        "Ask Ben",
    )
    cy.takes_picture(pictures, "start_page")
    tag = ".job:has-text('Tag-v0'):not(.over) a.main"
    cy.does(
        "opens Ben's game", lambda page: page.locator(tag).click(), "Ben drives the runner. Ask"
    )
    cy.does("asks for the runner", button("Ben drives the runner. Ask"), "You have asked Ben")
    protocol.wait(2.0)
    ben.takes_picture(pictures, "asked_on_a_phone")
    ben.does("says no", button("No"))
    protocol.wait(2.0)
    cy.takes_picture(pictures, "refused_across")
    cy.does("drives the catcher instead", button("Drive the catcher"))
    cy.does("drives to the left", lambda page: drives(page, "ArrowLeft"))
    protocol.wait(rest_s)

    ada.does("reloads the page", lambda page: page.reload(), "you drive")
    ada.does("drives on", drives)
    protocol.wait(rest_s)

    ben.does("asks for the catcher", button("Cy drives the catcher. Ask"), "You have asked Cy")
    cy.does("says yes", button("Yes"))
    protocol.wait(2.0)
    ben.does("drives the catcher", drives)
    protocol.wait(rest_s)

    cy.does(
        "stops everything with the space bar",
        lambda page: page.keyboard.press("Space"),
        "Confirmed",
    )
    protocol.wait(2.0)
    cy.takes_picture(pictures, "confirmed_across")
    ben.takes_picture(pictures, "stopped_by_another_on_a_phone")
    ben.does("Reset", button("Reset"), "running")
    protocol.wait(rest_s)

    frozen = pid_of(command, "drive")
    protocol.write("the computer", does="freezes the process of Ada's robot")
    os.kill(frozen, signal.SIGSTOP)
    ada.does("EMERGENCY STOP", button("EMERGENCY STOP"), "No connection")
    ada.takes_picture(pictures, "no_connection")
    protocol.wait(6.0)
    ada.takes_picture(pictures, "no_connection_later")
    protocol.write("the computer", does="lets it go on")
    os.kill(frozen, signal.SIGCONT)
    protocol.wait(10.0)
    ada.takes_picture(pictures, "connected_again")
    if ada.page.locator("#state:text-is('STOPPED')").count():
        ada.does("Reset", button("Reset"), "running")
    ada.does("drives on", drives)
    protocol.wait(rest_s)

    ben.does(
        "goes back to the start page",
        lambda page: page.get_by_role("link", name="Start").click(),
        "Ask Ada",
    )
    ben.does("asks Ada to end her robot", button("Ask Ada to end it"), "You have asked Ada")
    ada.does(
        "goes to the start page too",
        lambda page: page.get_by_role("link", name="Start").click(),
        "Ben asks for your",
    )
    ada.takes_picture(pictures, "asked_to_end")
    ada.does("says yes", button("Yes"), "as you said yes")
    protocol.wait(rest_s)


def main(session: Session) -> None:
    """Let three visitors come, and write the protocol."""
    args = session.parse(minutes=10.0)
    # Eight rests; what is done between them takes as long as one more.
    rest_s = args.minutes * 60.0 / 9.0
    pictures = session.folder
    pictures.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix="bricksrl-visitors-"))
    with Command(("page",), folder, has_terminal=False) as command, sync_playwright() as playwright:
        command.wait_for(lambda: "live page: " in command.said, "the page")
        url = command.said.partition("live page: ")[2].split()[0]
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(FLAGS)
        )
        protocol = Protocol()
        protocol.visits = [Visit(name, browser, url, protocol) for name in SIZES]
        try:
            story(command, protocol, pictures, rest_s)
            jobs = len(command.processes()) - 1
            for visit in protocol.visits[1:]:
                visit.leave()
            del protocol.visits[1:]
            protocol.wait(12.0)
            left = len(command.processes()) - 1
            protocol.write(
                "the computer",
                does=f"had {jobs} processes of robots, and has {left} after their visitors left",
            )
        finally:
            browser.close()
        os.kill(command.pid, signal.SIGHUP)
        ended_s = time.monotonic()
        while command.processes() and time.monotonic() < ended_s + 20.0:
            time.sleep(0.05)
        after_s = time.monotonic() - ended_s
        still = len(command.processes())
        protocol.write(
            "the computer",
            does=f"closes the terminal; {still} processes are left after {after_s:.1f} s",
        )
        result = {
            "seconds": protocol.now_s,
            "script_errors": protocol.errors,
            "processes_left": still,
        }
        result |= {
            "port_is_free": is_free(url),
            "processes_of_plays_left": left,
            "protocol": protocol.lines,
        }
    shutil.rmtree(folder, ignore_errors=True)
    session.write(result)
