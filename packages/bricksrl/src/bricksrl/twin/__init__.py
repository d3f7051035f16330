"""Names of `bricktwin.twin`, for programs that import only bricksrl."""
