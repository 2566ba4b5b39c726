"""Messages and clocks of a run, its log and its picture."""
