"""Formula of an approach: see `approach.py`."""
# mypy: ignore-errors

# --- the hub's part ---


def approach_at(distance_mm, goal_mm, gain, top_mm_s):
    """Share of the top speed: so many mm/s for each mm of way to the goal."""
    share = gain * (distance_mm - goal_mm) / top_mm_s
    return max(-1.0, min(1.0, share))
