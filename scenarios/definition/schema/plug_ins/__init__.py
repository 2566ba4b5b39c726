"""Classes that a scenario selects by name, shipped or user-defined, with tables of parameters."""
