"""Laws of a directed link, each a class and a line of the registry."""
