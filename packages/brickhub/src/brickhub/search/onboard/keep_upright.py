"""Formula of keeping upright on two wheels: see `upright.py`."""
# mypy: ignore-errors

# --- the hub's part ---


def keep_upright(observed, numbers):
    """Share of the battery's voltage for both wheels, by pitch, pitch rate, angle and speed."""
    pitch_deg, rate_deg_s, angle_deg, speed_deg_s = observed
    lean_deg, gain, ahead_s, by_angle, by_speed = numbers
    off_deg = pitch_deg - lean_deg + ahead_s * rate_deg_s
    off_deg += by_angle * angle_deg + by_speed * speed_deg_s
    return max(-1.0, min(1.0, gain * off_deg / 100))
