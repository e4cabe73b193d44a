"""Text to Job or Stream, with diagnostics. The only importer of lark."""
