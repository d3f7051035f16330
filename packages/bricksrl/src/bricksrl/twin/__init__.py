"""Names of `bricktwin.twin` under their earlier place."""
