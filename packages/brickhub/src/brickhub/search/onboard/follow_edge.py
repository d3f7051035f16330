"""Formula of following the edge of a line: see `edge.py`."""
# mypy: ignore-errors

# --- the hub's part ---


def follow_edge(reflection_pct, edge_pct, gain, top_deg_s, back_deg_s=0.0):
    """Share of the fastest turn: so many deg/s for each percent that is brighter than the edge, and
    so many more."""
    share = (gain * (reflection_pct - edge_pct) + back_deg_s) / top_deg_s
    return max(-1.0, min(1.0, share))
