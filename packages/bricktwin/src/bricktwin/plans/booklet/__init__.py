"""Booklet of a plan: its pages, their pictures, its steps in words, and the list of its parts."""
