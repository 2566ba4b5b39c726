"""Radio laws: losses by distance, by vehicles in between and by shared resources."""
