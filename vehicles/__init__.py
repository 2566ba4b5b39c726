"""What a vehicle is and decides: pure functions of state, time and messages; no input or output."""
