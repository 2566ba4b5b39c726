"""`python -m scenarios.cli` is `convoy`."""

from scenarios.cli.main import main

main()
