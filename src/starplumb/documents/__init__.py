"""Every JSON document as a pydantic model with its schema: what is written is checked, and what is read back too."""
