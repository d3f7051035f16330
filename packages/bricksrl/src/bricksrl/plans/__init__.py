"""Names of `bricktwin.plans` under their earlier place."""
