"""From raw images: measuring, and an example of it."""
