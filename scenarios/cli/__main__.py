"""`convoy` and `python -m scenarios.cli`: set signal handlers, then import and run the command."""

import gc
import os
import sys

COLLECTED_EVERY = 50_000
"""Threshold of the garbage collector; the default of 700 makes imports 4 % slower."""


def main() -> None:
    gc.set_threshold(COLLECTED_EVERY)
    try:
        from scenarios.cli.output import open_standard_files
        from scenarios.runs.stop import end_on_signals

        open_standard_files()
        # The launcher reports the signals of the processes that it starts.
        end_on_signals(report="--parent-watch" not in sys.argv)
    except KeyboardInterrupt:  # before the handlers are set
        os.write(2, b"stopped by SIGINT\n")
        os._exit(130)
    from scenarios.cli.main import main as run_command

    run_command()


if __name__ == "__main__":
    main()
