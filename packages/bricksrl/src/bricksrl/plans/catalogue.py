"""Catalogue of parts, of `bricktwin.plans.catalogue`."""

from __future__ import annotations

from bricktwin.plans.catalogue import *
