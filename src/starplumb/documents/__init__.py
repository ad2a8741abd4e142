"""Every JSON document as a pydantic model with its schema: the shape of each file, and the check of what is read back.

What writes a document makes a dictionary; ``tests/test_documents.py`` holds it to its model to the byte.  Building the
models takes some 20 ms, which a command that only writes would spend for nothing."""
