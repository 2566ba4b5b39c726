"""The picture of a run, live and from its log, here and in other programs."""
