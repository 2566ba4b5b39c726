"""One vehicle as a node: the same object on the wall clock and in virtual time."""
