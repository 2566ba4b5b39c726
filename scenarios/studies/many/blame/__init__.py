"""`convoy blame`: the losses that caused the worst figure of a recorded run."""
