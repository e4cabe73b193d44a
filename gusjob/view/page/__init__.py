"""The report as one self-contained HTML page; it loads nothing from elsewhere."""
