"""Visitors of a page, what each of them holds, such as a robot that is driven, and who asks whom
for it.

A visitor is one browser, in one tab or several. Who reloads the page, or has closed it, is away
after :data:`AWAY_S`, and what was held is free; who comes back before somebody else has taken it
holds it again.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

AWAY_S = 5.0
"""Time without a tab after which a visitor is away."""
ASK_S = 60.0
"""Time after which a question that is not answered is withdrawn."""
_MAX_NAME = 24
_MAX_KNOWN = 64
_OUR_NAME = re.compile(r"Visitor \d+( \(\d+\))?")


@dataclass(eq=False)
class Visitor:
    """Somebody who looks at the page.

    Attributes:
        name: given by the visitor, or ``Visitor 2``; no two have the same.
        key: digest of the browser's secret, the same on all pages of this computer.
        tabs: number of open tabs.
        left_s: monotonic time at which the last one was closed.
        is_asleep: whether the last connection broke without a word, as that of a phone that sleeps.
        note: what the page has to say to this visitor alone.
    """

    name: str
    key: str
    tabs: int = 0
    left_s: float = 0.0
    is_asleep: bool = False
    note: str = ""

    @property
    def given_name(self) -> str:
        """The name that the visitor has given; empty for one of ours."""
        return "" if _OUR_NAME.fullmatch(self.name) else self.name

    @property
    def is_away(self) -> bool:
        """Whether there has been no tab for :data:`AWAY_S`."""
        return not self.tabs and time.monotonic() - self.left_s > AWAY_S


class Visitors:
    """All visitors of a page, by the secrets of their browsers."""

    def __init__(self) -> None:
        self._known: dict[str, Visitor] = {}
        self._count = 0

    def arrive(
        self,
        secret: str,
        name: str,
    ) -> Visitor:
        """The visitor who opens a tab."""
        visitor = self._known.get(secret)
        if visitor is None:
            self._forget()
            self._count += 1
            key = hashlib.sha256(secret.encode()).hexdigest()[:16]
            visitor = self._known[secret] = Visitor("", key, left_s=time.monotonic())
            self.rename(visitor, name or f"Visitor {self._count}")
        visitor.tabs += 1
        visitor.is_asleep = False
        return visitor

    def leave(
        self,
        visitor: Visitor,
        *,
        closed: bool,
    ) -> None:
        """Note that a tab is gone; ``closed``: the browser has said so."""
        visitor.tabs -= 1
        visitor.left_s = time.monotonic()
        visitor.is_asleep = not closed

    def rename(
        self,
        visitor: Visitor,
        name: object,
    ) -> None:
        """Give a visitor a name, with a number if somebody else has it; what is no name is
        ignored."""
        if not isinstance(name, str):
            return
        # Letters that turn a line around, or break it, would let a name look like another one.
        printable = "".join(letter if letter.isprintable() else " " for letter in name)
        words = " ".join(printable.split())
        wanted = words[:_MAX_NAME].strip()
        if not wanted:
            return
        others = {other.name for other in self._known.values() if other is not visitor}
        number = 1
        unique = wanted
        while unique in others:
            number += 1
            unique = f"{wanted} ({number})"
        visitor.name = unique

    def here(self) -> list[Visitor]:
        """Those who have a tab open, in the order of their arrival."""
        return [visitor for visitor in self._known.values() if visitor.tabs]

    def described(self) -> dict[str, Any]:
        """Who is here, whether somebody's connection broke, and whether anybody has ever come, for
        the start page."""
        away = [visitor for visitor in self._known.values() if not visitor.tabs]
        return {
            "here": [visitor.key for visitor in self.here()],
            "asleep": any(visitor.is_asleep for visitor in away),
            "came": self._count > 0,
        }

    def _forget(self) -> None:
        """Forget the visitor who left first, where too many are known."""
        away = []
        for secret, visitor in self._known.items():
            if visitor.is_away:
                away.append((visitor.left_s, secret))
        if len(self._known) >= _MAX_KNOWN and away:
            _, first = min(away)
            del self._known[first]


@dataclass(frozen=True)
class Question:
    """Question of a visitor for what another one holds. ``since_s``: monotonic time."""

    by: Visitor
    since_s: float


class Seats:
    """What is held, by name, and the questions for it; each visitor holds one at most, unless
    ``holds_several``."""

    def __init__(self, *, holds_several: bool = False) -> None:
        self._holds_several = holds_several
        self._holders: dict[str, Visitor] = {}
        self._former: dict[str, Visitor] = {}
        self._questions: dict[str, Question] = {}

    def holder(self, name: str) -> Visitor | None:
        """Who holds it and is not away."""
        visitor = self._holders.get(name)
        return None if visitor is None or visitor.is_away else visitor

    def may(
        self,
        name: str,
        visitor: Visitor | None,
    ) -> bool:
        """Whether a visitor may use it: nobody else holds it. ``None`` stands for the program
        itself."""
        return visitor is None or self.holder(name) in (None, visitor)

    def take(
        self,
        name: str,
        visitor: Visitor,
    ) -> list[str]:
        """Let a visitor hold it; the names of what is free now."""
        left = []
        if not self._holds_several:
            left = [held for held, by in self._holders.items() if by is visitor and held != name]
        for held in left:
            self.give_back(held)
        self._holders[name] = visitor
        self._former.pop(name, None)
        self._questions.pop(name, None)
        visitor.note = ""
        return left

    def give_back(self, name: str) -> None:
        """Free it."""
        self._holders.pop(name, None)
        self._former.pop(name, None)
        if (question := self._questions.pop(name, None)) is not None:
            question.by.note = f"The {name} is free now."

    def ask(
        self,
        name: str,
        visitor: Visitor,
    ) -> bool:
        """Ask the holder; True if there is nobody to ask, so that the visitor may take it."""
        if self.may(name, visitor):
            return True
        other = self._questions.get(name)
        if other is not None and other.by is not visitor:
            visitor.note = f"{other.by.name} has asked already; ask again in a moment."
            return False
        self._questions[name] = Question(visitor, time.monotonic())
        visitor.note = ""
        return False

    def answer(
        self,
        name: str,
        visitor: Visitor,
        *,
        agrees: bool,
    ) -> Visitor | None:
        """Answer of the holder; the visitor who asked, if it is a yes."""
        question = self._questions.get(name)
        if question is None or self._holders.get(name) is not visitor:
            return None
        del self._questions[name]
        if not agrees:
            question.by.note = f"{visitor.name} says no."
            return None
        visitor.note = f"{question.by.name} has it now, as you said yes."
        return question.by

    def refresh(self) -> tuple[list[str], list[str]]:
        """Look who is away, and who is back: names of what is free now, and of what is held again
        by its former holder."""
        freed = list[str]()
        again = list[str]()
        for name, visitor in list(self._holders.items()):
            if visitor.is_away:
                self.give_back(name)
                self._former[name] = visitor
                freed.append(name)
        # Who comes back finds everything as it was left, unless somebody has taken it meanwhile.
        for name, visitor in list(self._former.items()):
            if visitor.tabs and name not in self._holders:
                self.take(name, visitor)
                again.append(name)
            elif name in self._holders:
                del self._former[name]
                visitor.note = f"You were away; {self._holders[name].name} has it now."
        for name, question in list(self._questions.items()):
            if question.by.is_away:
                del self._questions[name]
            elif time.monotonic() - question.since_s > ASK_S:
                del self._questions[name]
                question.by.note = f"{self._holders[name].name} has not answered."
        return freed, again

    def described(self) -> Mapping[str, dict[str, str]]:
        """Names of holders and of those who ask, for the page."""
        holders = {}
        for name in self._holders:
            visitor = self.holder(name)
            if visitor is not None:
                holders[name] = visitor.name
        questions = {name: question.by.name for name, question in self._questions.items()}
        return {"holders": holders, "questions": questions}
