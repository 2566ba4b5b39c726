"""Proof that a control message is from this run: seals, and the secrets of start and end.

A seal is an HMAC-SHA256. Its key consists of the run's key, which the processes of a run share, and
the name of the recorder, which no two runs have in common. Start and end carry secrets that only
the recorder knows before it sends them; its name is the hash of the first, which is the hash of the
second.
"""

import hmac
import os
from collections import Counter
from collections.abc import Callable
from hashlib import sha256
from threading import Lock

KEY_VARIABLE = "CONVOY_RUN_KEY"
"""Environment variable with the key of a run; `convoy run` draws one for its processes."""
TAG_DIGITS = 32
"""Hexadecimal digits of a seal, at the beginning of the message."""


def run_key() -> str:
    """Key of the runs of this process, empty if none was given."""
    return os.environ.get(KEY_VARIABLE, "")


def key_digest(key: str) -> str:
    """Text by which processes with different keys notice it."""
    return _digest(f"key {key}")[:8] if key else "none"


def start_secret(secret: str) -> str:
    """Secret of the start of the run that ends with `secret`."""
    return _digest(secret)


def recorder_name(secret: str) -> str:
    """Name of the recorder whose run ends with `secret`."""
    return _digest(start_secret(secret))


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()


class Seal:
    """Makes and recognises the control messages of one run; counts forged ones, on any thread."""

    def __init__(self, recorder: Callable[[], str], key: str | None = None) -> None:
        """`recorder` returns the name of the run's recorder, empty while it is unknown.

        `key` is that of the run, by default this process's. Without a recorder every message is
        refused and none is counted, because a true one will be repeated.
        """
        self._recorder = recorder
        self._run_key = run_key() if key is None else key
        self._lock = Lock()
        self._forged: Counter[str] = Counter()
        self._reported: set[str] = set()

    @property
    def knows_recorder(self) -> bool:
        """Whether others can recognise what is sealed now."""
        return bool(self._recorder())

    def sealed(self, purpose: str, content: bytes) -> bytes:
        return self._tag(purpose, content) + content

    def opened(self, purpose: str, data: bytes) -> bytes | None:
        """Content of a message sealed for `purpose`; None for any other message."""
        tag, content = data[:TAG_DIGITS], data[TAG_DIGITS:]
        is_true = hmac.compare_digest(tag, self._tag(purpose, content))
        return content if self._judge(purpose, is_true=is_true) else None

    def starts(self, secret: str) -> bool:
        """Whether a start with `secret` is from the run's recorder."""
        return self._judge("start", is_true=_digest(secret) == self._recorder())

    def ends(self, secret: str) -> bool:
        """Whether an end with `secret` is from the run's recorder."""
        return self._judge("end", is_true=recorder_name(secret) == self._recorder())

    def count_forged(self, kind: str) -> None:
        with self._lock:
            self._forged[kind] += 1

    def take_forged(self) -> tuple[int, list[str]]:
        """Count of forged messages since the last call, and a line for each kind that is new."""
        if not self._forged:  # as mostly
            return 0, []
        with self._lock:
            counts, self._forged = self._forged, Counter()
        new = sorted(counts.keys() - self._reported)
        self._reported.update(new)
        return counts.total(), [f"ignored a forged {kind}: not from this run" for kind in new]

    def _judge(self, kind: str, *, is_true: bool) -> bool:
        if not self._recorder():
            return False
        if not is_true:
            self.count_forged(kind)
        return is_true

    def _tag(self, purpose: str, content: bytes) -> bytes:
        key = f"{self._run_key} {self._recorder()}".encode()
        signed = purpose.encode() + b"\n" + content
        return hmac.new(key, signed, sha256).hexdigest()[:TAG_DIGITS].encode()
