"""Catalogue of parts, of `bricktwin.plans.catalogue`."""

from bricktwin.plans.catalogue import *
