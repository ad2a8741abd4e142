"""What to take next."""
