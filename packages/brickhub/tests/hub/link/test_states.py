"""The state table: completeness and documentation."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub import errors
from brickhub.errors import HubError, StoppedError
from brickhub.hub.link.states import Cause, LinkState, after, cause_of, markdown

LINK_DOC = (Path(__file__).parents[5] / "docs" / "link.md").read_text(encoding="utf-8")


def test_every_cause_has_a_defined_action() -> None:
    for cause in Cause:
        assert cause.value.before and cause.value.host and cause.value.hub
    assert len({cause.value.event for cause in Cause}) == 14


def test_errors_lead_to_states_of_table() -> None:
    for cause in Cause:
        for error in cause.value.errors:
            assert cause_of(error("what happened; what to do")) is cause
            assert cause.value.after is LinkState.FAULT
    for name in dir(errors):
        kind = getattr(errors, name)
        if isinstance(kind, type) and issubclass(kind, HubError) and kind is not HubError:
            assert cause_of(kind("what happened; what to do")) is not Cause.UNKNOWN, name
    assert cause_of(StoppedError("")) is Cause.HALTED
    assert cause_of(errors.BricksError("of nothing that is in the table")) is Cause.UNKNOWN


def test_every_state_can_recover() -> None:
    assert {state for state in LinkState if LinkState.READY in _reachable(state)} == set(LinkState)


def _reachable(start: LinkState) -> set[LinkState]:
    found, frontier = {start}, [start]
    while frontier:
        state = frontier.pop()
        new = {row.after for row in (cause.value for cause in Cause) if state in row.before} - found
        found |= new
        frontier += new
    return found


def test_only_an_open_link_is_armed() -> None:
    for state in (LinkState.DISCONNECTED, LinkState.FAULT):
        with pytest.raises(ValueError, match="cannot come while the link is"):
            after(state, Cause.ACTED)
    assert after(LinkState.READY, Cause.ACTED) is LinkState.ARMED


def test_documentation_has_state_table() -> None:
    assert markdown() in LINK_DOC
    head, _, *rows = markdown().splitlines()
    assert len(rows) == len(Cause)
    for row, cause in zip(rows, Cause, strict=True):
        assert row.count(" | ") == head.count(" | ")
        assert row.startswith(f"| {cause.value.event} | ")
        assert row.endswith(f" | {cause.value.host} | {cause.value.hub} |")
    (armed,) = [row for row in rows if "the program ended because it had not heard" in row]
    assert "| READY, ARMED | FAULT | `SilentHubError` |".lower() in armed.lower()
