"""Queries that name their run: members of another run with the same name do not answer them."""

from secrets import token_hex


def random_run_id() -> str:
    return token_hex(8)


def addressed(run_id: str, content: bytes) -> bytes:
    """Query to members of the run with this identifier."""
    return run_id.encode() + b"\n" + content


def content_of(query: bytes, run_id: str) -> bytes | None:
    """Content of a query to this run; None for any other query, or while the run is unknown."""
    addressee, line_feed, content = query.partition(b"\n")
    return content if line_feed and run_id and addressee == run_id.encode() else None
