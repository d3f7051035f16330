"""Formula of linear feedback: see `feedback.py`."""
# mypy: ignore-errors

import math as umath

# --- the hub's part ---


def feed_back(features, size, observed, numbers):
    """A matrix, row by row, times the features and 1."""
    inputs = []
    for index, factor, offset, is_angle in features:
        value = observed[index] * factor + offset
        inputs += [umath.sin(value), umath.cos(value)] if is_angle else [value]
    inputs.append(1.0)
    width = len(inputs)
    actions = []
    for row in range(size):
        total = 0.0
        for column in range(width):
            total += inputs[column] * numbers[row * width + column]
        actions.append(max(-1.0, min(1.0, total)))
    return actions
