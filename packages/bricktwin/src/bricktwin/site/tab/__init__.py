"""Python of a tab's worker, under Pyodide; it imports nothing that is not in the site."""
