"""Reports: rows and totals of a trace as tables, markdown, JSON, CSV and Parquet, and the comparison of two reports."""
