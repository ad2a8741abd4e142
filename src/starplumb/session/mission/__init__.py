"""What a session says of a mission: its archive and its trend."""
