"""The picture of a run in Rerun, live or from its log."""
