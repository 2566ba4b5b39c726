"""The lead's view of its own convoy, from the poses of its followers."""
