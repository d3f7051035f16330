"""Templates of `bricksrl new`: files that are copied for the user, who goes on from there."""
