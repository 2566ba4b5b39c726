"""`convoy channel`: compare laws with samples, fit laws to logs."""
