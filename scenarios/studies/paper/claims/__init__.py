"""Claims of the paper, each registered with the function that answers it."""
