"""`convoy bisect`: the value of a key from which on a share of the runs breaks a limit."""
