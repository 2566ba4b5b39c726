"""What composes a run: scenarios, processes, launcher, recorder, figures, the command line."""
