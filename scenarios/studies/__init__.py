"""Many runs and the theory behind them: stabilising gains, the paper's claims."""
