"""Templates of `bricksrl new`, which are copied for the user."""
