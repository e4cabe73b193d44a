"""The report as one page for a browser: everything is in it, nothing is loaded from elsewhere."""
