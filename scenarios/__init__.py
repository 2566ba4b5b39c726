"""What composes a run: scenario files, vehicle processes, launcher, recorder, review, command line."""
