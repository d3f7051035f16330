"""Names of `brickhub.hub`, for programs that import only bricksrl."""
