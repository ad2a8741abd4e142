"""What a session says of mountings that move."""
