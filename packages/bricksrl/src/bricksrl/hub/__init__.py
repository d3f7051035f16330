"""Names of `brickhub.hub` under their earlier place."""
