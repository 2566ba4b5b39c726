"""The mcap package as it might become: it does the same under other private names."""

from typing import IO, Any

from mcap.writer import Writer


class RenamedWriter:
    """The package's writer without the private attributes that it has in the locked version."""

    def __init__(self, file: IO[bytes]) -> None:
        self.renamed = Writer(file)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.renamed, name)
