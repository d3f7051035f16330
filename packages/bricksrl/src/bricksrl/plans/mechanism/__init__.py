"""Names of `bricktwin.plans.mechanism` under their earlier place."""
