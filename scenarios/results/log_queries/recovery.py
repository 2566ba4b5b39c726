"""`convoy recover`: the readable messages of a truncated or damaged log as a new log."""

import shutil
from pathlib import Path

from transport.log.reader import LogReader
from transport.log.records import LogError, UnwritableError
from transport.log.repair import repair


def recover_log(log: Path, output: Path) -> int:
    """Write every readable message of a truncated or damaged log; returns their number."""
    if output.exists():
        raise LogError(f"{output}: exists; a log is never overwritten")
    LogReader(log)  # refuse other files
    part = output.with_name(output.name + ".part")
    try:
        shutil.copyfile(log, part)
        repair(part, also_damaged=True)
        part.rename(output)
    except OSError as error:
        raise UnwritableError(f"{output}: cannot write the log: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return sum(LogReader(output).counts.values())
