"""What differs between controllers."""
