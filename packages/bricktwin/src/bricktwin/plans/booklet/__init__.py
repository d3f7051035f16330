"""Booklet of a plan: its pages, the pictures on them, its steps in words, and the list of its parts."""
