"""Booklets that come with a checkout, in its folder ``docs/plans``. Each says in its keywords of
which plan it is, so that one of a plan that has changed since is not taken for it."""

import hashlib
from pathlib import Path

from brickhub.errors import PlanError
from bricktwin.plans.ldraw_text import sources_of


def digest_of(plan: Path) -> str:
    """Digest of a plan's file and of those beside it that it is made of, as 64 digits; empty if it
    cannot be read."""
    digest = hashlib.sha256()
    try:
        for source in sources_of(plan):
            # Its length goes first, as else two files could be one that is as long as both.
            digest.update(len(source).to_bytes(8, "big") + source)
    except (OSError, PlanError):
        return ""
    return digest.hexdigest()


def committed_booklet(plan: Path) -> Path | None:
    """The PDF of this very plan in the checkout that the plan's file is in; ``None`` if there is
    none, as in an installed package."""
    for folder in plan.resolve().parents:
        path = folder / "docs" / "plans" / f"{plan.stem}.pdf"
        if path.is_file():
            digest = digest_of(plan)
            return path if digest and digest.encode() in path.read_bytes() else None
    return None
