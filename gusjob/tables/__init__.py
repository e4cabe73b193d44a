"""Tables as equally long columns, and their export."""
