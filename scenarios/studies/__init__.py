"""Studies: many runs, and the theory behind them."""
