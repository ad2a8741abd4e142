"""The objects of a session that go from pixels to the ground and back."""
