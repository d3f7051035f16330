"""Site for browsers: the hub, robots and their physics in a tab, in a folder of plain files."""
