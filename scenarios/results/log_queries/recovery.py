"""`convoy recover`: the readable messages of a truncated or damaged log as a new log."""

from pathlib import Path

from transport.log.errors import LogError, UnwritableError
from transport.log.mcap_file import write_again
from transport.log.reader import LogReader


def recover_log(log: Path, output: Path) -> int:
    """Write every readable message of a truncated or damaged log; returns their number."""
    if output.exists():
        raise LogError(f"{output}: exists; a log is never overwritten")
    reader = LogReader(log)  # refuse other files
    part = output.with_name(output.name + ".part")
    try:
        write_again(reader.file, part)
        part.rename(output)
    except OSError as error:
        raise UnwritableError(f"{output}: cannot write the log: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return sum(reader.counts.values())
