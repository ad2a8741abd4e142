"""The life of a mission: campaigns solved together, the mounting's trend, what to do about it; plain data, no files."""
