"""What runs in a tab's worker, under Pyodide: imports nothing that is not in the site."""
