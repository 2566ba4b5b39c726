"""The bus over Eclipse Zenoh, the only module that imports zenoh.

Usually all processes are clients of one router. A router does not forward between two peers, so
peers need each other's endpoints, or gossip through a third peer.
"""

import json
import logging
import os
import re
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import zenoh

from transport.bus.bus import AliveHandler, Answer, ArrivalHandler, BusError, Fetch, Handler, Member
from transport.bus.zenoh_options import DEFAULT_ENDPOINT, DEFAULTS, ZenohOptions
from transport.closing import Closing
from transport.topics import TOPICS, alive_key

__all__ = [
    "DEFAULT_ENDPOINT",
    "Router",
    "ZenohBus",
    "ZenohOptions",
    "open_bus",
    "open_router",
    "prepare_bus",
]

FLUSH_S = 1.0  # Maximum wait at closing for the router to receive all publications
ALL_MEMBERS = alive_key("*", "*", "*", "*")  # Matches the liveliness tokens of all members
MEMBERS_S = 10.0  # Timeout of the query for members, which takes a round trip
LONGER = 2.0  # Factor from the first connection's timeout to the second's
ANSWER_S = 2.0  # How long to wait for a connection that only shows whether a program listens

_LOG_FILTER = "error,zenoh::api::session=off"
"""Zenoh's log filter, unless RUST_LOG is set. Sessions log errors for messages that arrive while
they close."""
_URGENT = zenoh.Priority.DATA_HIGH
_EVERYBODY, _EACH_ANSWER = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
"""A stranger's answer must not displace that of the member that was asked."""
_SETTLE_S = 0.01
"""After the loss of the router all tokens disappear, and `connected()` is False within 3 ms
(measured)."""

_ONE_THREAD = (
    "(app: (worker_threads: 1), acc: (handover: app), tx: (handover: app), "
    "rx: (handover: app), net: (handover: app))"
)
"""All tasks of Zenoh on one thread: with its default of a thread per task, five times as many ticks
are late in forty processes on two cores (measured)."""

logger = logging.getLogger(__name__)
_SOURCE_LINE = re.compile(r" at /\S+?\.rs:\d+\.?")
_INNER = re.compile(r'(?:Str\(|msg: )"(.*?)"[,)]')


class ZenohBus(Closing):
    """A Zenoh session; open it with `open_bus` and close it with `with`.

    An unclosed session keeps the interpreter from exiting, also after an exception.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[tuple[str, bool], zenoh.Publisher] = {}
        self._declared: list[object] = []  # subscribers and tokens end when they are deleted
        self._announced: set[str] = set()
        self._published = False
        self.close_timeout_s = FLUSH_S
        self.zid = str(session.zid())  # as Zenoh's own tools print it

    def connected(self) -> bool:
        """Whether a router or peer is linked; on the loss of the router all members disappear."""
        return bool(self._session.info.transports())

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        publisher = self._publishers.get((key, urgent))
        if publisher is None:
            publisher = self._publishers[key, urgent] = self._declare(key, urgent=urgent)
        try:  # not _as_bus_error, which is too slow for 200 messages a second
            publisher.put(data)
        except zenoh.ZError as error:
            raise BusError(f"cannot publish {key}: {_reason(error)}") from None
        self._published = True

    def subscribe(self, key_expression: str, handler: Handler) -> None:

        def receive(sample: zenoh.Sample) -> None:
            try:
                handler(str(sample.key_expr), sample.payload.to_bytes())
            except Exception:  # an error must not end the subscription
                logger.exception("handler of %s failed", key_expression)

        with _as_bus_error(f"cannot subscribe {key_expression}"):
            self._declared.append(self._session.declare_subscriber(key_expression, receive))

    def collect(
        self, key: str, handler: ArrivalHandler, most: int, now: Callable[[], int]
    ) -> Fetch:
        """As `Bus.collect`; Zenoh's thread only notes the instant of arrival."""
        kept: deque[tuple[zenoh.Sample, int]] = deque(maxlen=most)
        with _as_bus_error(f"cannot subscribe {key}"):
            subscriber = self._session.declare_subscriber(
                key, lambda sample: kept.append((sample, now()))
            )
        self._declared.append(subscriber)

        def fetch() -> bool:
            is_full = len(kept) == most
            while kept:
                sample, arrived_at = kept.popleft()
                handler(key, sample.payload.to_bytes(), arrived_at)
            return is_full

        return fetch

    def answer(self, key: str, answer: Answer) -> None:
        """Answer each query for `key`, on a thread of Zenoh."""

        def reply(query: zenoh.Query) -> None:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            try:
                query.reply(key, answer(payload))
            except Exception:  # as above
                logger.exception("answer for %s failed", key)

        with _as_bus_error(f"cannot answer for {key}"):
            self._declared.append(self._session.declare_queryable(key, reply))

    def query(self, key: str, timeout_s: float, payload: bytes = b"") -> bytes | None:
        with _as_bus_error(f"cannot query {key}"):
            replies = self._session.get(
                key, timeout=timeout_s, priority=_URGENT, payload=payload or None
            )
            for reply in replies:
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
        return None

    def request(
        self, key: str, handler: Callable[[bytes], None], timeout_s: float, payload: bytes = b""
    ) -> None:
        """As `Bus.request`; errors and timeouts are no answers."""

        def receive(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                handler(reply.ok.payload.to_bytes())

        with _as_bus_error(f"cannot query {key}"):
            self._session.get(
                key,
                receive,
                target=_EVERYBODY,
                consolidation=_EACH_ANSWER,
                timeout=timeout_s,
                priority=_URGENT,
                payload=payload or None,
            )

    def announce(self, role: str, name: str, fingerprint: str) -> None:
        token = alive_key(role, name, fingerprint, self.zid)
        if token in self._announced:
            return
        with _as_bus_error(f"cannot announce {name}"):
            self._declared.append(self._session.liveliness().declare_token(token))
        self._announced.add(token)

    def watch(self, handler: AliveHandler) -> None:
        """Call `handler` for every member alive now, and once for every change.

        On the loss of the router every member is reported as gone, and `connected()` is already
        False; members are reported again when the router is back.
        """
        alive: set[Member] = set()

        def receive(sample: zenoh.Sample) -> None:
            member = _member(sample.key_expr)
            is_alive = sample.kind == zenoh.SampleKind.PUT
            if is_alive == (member in alive):
                return
            (alive.add if is_alive else alive.discard)(member)
            if not is_alive and self.connected():
                time.sleep(_SETTLE_S)
            try:
                handler(member, is_alive)
            except Exception:  # as above
                logger.exception("handler of liveliness failed")

        with _as_bus_error("cannot watch the members of the run"):
            self._declared.append(
                self._session.liveliness().declare_subscriber(ALL_MEMBERS, receive, history=True)
            )

    def members(self) -> set[Member]:
        """Query the router for the members alive now.

        In a session that has called `watch` the answer is often empty while Zenoh delivers the
        history (measured; without a watch 800 of 800 answers were right).
        """
        with _as_bus_error("cannot query the members of the run"):
            replies = self._session.liveliness().get(ALL_MEMBERS, timeout=MEMBERS_S)
            return {_member(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    def close(self) -> None:
        """Wait until the router has received all publications, then close the session."""
        if self._session.is_closed():
            return
        if self._published:
            self._flush()
        self._publishers.clear()
        self._declared.clear()
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it

    def _flush(self) -> None:
        """Wait for the queue to be received, with a query that nobody answers behind it."""
        unanswered = f"convoy/@flush/{self.zid}"
        try:
            list(
                self._session.get(
                    unanswered, priority=zenoh.Priority.DATA, timeout=self.close_timeout_s
                )
            )
        except zenoh.ZError:
            logger.debug("nothing to flush to")

    def _declare(self, key: str, *, urgent: bool) -> zenoh.Publisher:
        topic = TOPICS.get(key.rpartition("/")[2])
        encoding = zenoh.Encoding.APPLICATION_PROTOBUF
        with _as_bus_error(f"cannot publish {key}"):
            return self._session.declare_publisher(
                key,
                encoding=encoding.with_schema(f"convoy.{topic.message.__name__}")
                if topic
                else encoding,
                congestion_control=zenoh.CongestionControl.DROP,
                # Not "express": ten poses of one instant would take ten batches of the queue.
                priority=zenoh.Priority.DATA_HIGH if urgent else zenoh.Priority.DATA,
            )


class Router(Closing):
    """A Zenoh router in this process that listens on `endpoints`."""

    def __init__(self, session: zenoh.Session, endpoints: tuple[str, ...]) -> None:
        self._session = session
        self.endpoints = endpoints
        self.zid = str(session.zid())

    def has_clients(self) -> bool:
        return bool(self._session.info.transports())

    def close(self) -> None:
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


def _member(token: zenoh.KeyExpr) -> Member:
    return Member(*str(token).split("/")[2:])


def open_bus(options: ZenohOptions) -> ZenohBus:
    """Open a session; raises BusError."""
    config = prepare_bus(options)
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)
    zenoh.init_log_from_env_or(_LOG_FILTER)
    if config.get_json("mode") != '"client"':
        # A peer opens without other members, which may start later.
        with _as_bus_error("cannot open a peer"):
            return ZenohBus(zenoh.open(config))
    endpoints = config.get_json("connect/endpoints").strip("[]").replace('"', "")
    if not endpoints:
        raise BusError(f"a client needs a router to connect to, such as {DEFAULT_ENDPOINT}")
    try:
        return _connected(config, options.connect_timeout_s)
    except zenoh.ZError as error:
        if not any(map(_answers, endpoints.split(","))):
            why = f"cannot join through {endpoints} within {options.connect_timeout_s:g} s"
            raise BusError(f"{why}; is a router there?: {_reason(error)}") from None
    try:  # on a slow path that loses packets, a connection takes many round trips
        return _connected(config, LONGER * options.connect_timeout_s)
    except zenoh.ZError as error:
        longest = f"{(1 + LONGER) * options.connect_timeout_s:g} s"
        why = f"cannot join through {endpoints} within {longest}; {_refusal(config)}"
        raise BusError(f"{why}: {_reason(error)}") from None


def _connected(config: zenoh.Config, timeout_s: float) -> ZenohBus:
    """Connect within a timeout; raises ZError. Zenoh releases the interpreter's lock."""
    config.insert_json5("connect/timeout_ms", str(max(1, round(timeout_s * 1000))))
    return ZenohBus(zenoh.open(config))


def _refusal(config: zenoh.Config) -> str:
    """What to check after a router did not admit a client; Zenoh does not report it."""
    user = config.get_json("transport/auth/usrpwd/user")
    credentials = f"the password of user {user}" if user != "null" else "user and password"
    return (
        "a program answers there but does not admit this process; check "
        f"{credentials}, protocol, or the network, which may be too slow"
    )


def _answers(endpoint: str) -> bool:
    """Whether a program accepts TCP connections at an endpoint such as tls/host:7447."""
    address = re.split(r"[?#]", endpoint)[0].partition("/")[2]
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=ANSWER_S):
            return True
    except (OSError, ValueError, OverflowError):
        return False


@lru_cache(maxsize=1)
def prepare_bus(options: ZenohOptions) -> zenoh.Config:
    """Build the configuration of `open_bus` before processes are forked; raises BusError.

    This saves half a megabyte in each process.
    """
    return configuration(options, DEFAULTS)


def open_router(
    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,),
    *,
    connect: tuple[str, ...] = (),
    config: Path | None = None,
    cfg: tuple[str, ...] = (),
) -> Router:
    """Start a router; port 0 selects a free one. Raises BusError, for example for a port in use.

    The router connects to the routers at `connect` and retries while they are absent.
    """
    options = ZenohOptions(listen=listen, connect=connect, config=config, cfg=cfg)
    # Scouting is off, so there is no need to wait half a second for answers.
    chosen = configuration(options, DEFAULTS | {"scouting/delay": "0"})
    _insert(chosen, "mode", '"router"')
    any_port = any(endpoint.endswith(":0") for endpoint in listen)
    if any_port:
        _insert(chosen, "adminspace/enabled", "true")
    zenoh.init_log_from_env_or(_LOG_FILTER)
    with _as_bus_error(f"cannot listen on {', '.join(listen)}"):
        session = zenoh.open(chosen)
        return Router(session, _locators(session) if any_port else listen)


def _locators(session: zenoh.Session) -> tuple[str, ...]:
    for reply in session.get(f"@/{session.zid()}/router"):
        if reply.ok is not None:
            return tuple(json.loads(reply.ok.payload.to_bytes())["locators"])
    raise BusError("the router does not report the endpoints on which it listens")


def configuration(options: ZenohOptions, defaults: Mapping[str, str]) -> zenoh.Config:
    """Merge flags, the user's file and `defaults`, in this order of precedence.

    Raises BusError for settings that Zenoh refuses.
    """
    given, unset = zenoh.Config(), zenoh.Config()
    if options.config is not None:
        with _as_bus_error(f"cannot read {options.config}"):
            given = zenoh.Config.from_file(options.config)
    for setting, value in defaults.items():
        if given.get_json(setting) == unset.get_json(setting):
            _insert(given, setting, value)
    if options.mode is not None:
        _insert(given, "mode", json.dumps(options.mode))
    if options.run:
        _insert(given, "namespace", json.dumps(options.run))
    for setting, endpoints in (("connect", options.connect), ("listen", options.listen)):
        if endpoints:
            _insert(given, f"{setting}/endpoints", json.dumps(endpoints))
    for pair in options.cfg:
        setting, colon, value = pair.partition(":")
        if not colon:
            raise BusError(f"setting {pair!r} is not KEY:VALUE")
        _insert(given, setting, value)
    return given


def _insert(config: zenoh.Config, setting: str, value: str) -> None:
    with _as_bus_error(f"setting {setting}:{value}"):
        config.insert_json5(setting, value)


@contextmanager
def _as_bus_error(failure: str) -> Iterator[None]:
    """Turn Zenoh's errors into a BusError of one line, without the names of source files."""
    try:
        yield
    except zenoh.ZError as error:
        raise BusError(f"{failure}: {_reason(error)}") from None


def _reason(error: zenoh.ZError) -> str:
    text = " ".join(_SOURCE_LINE.sub("", str(error)).split())
    if "Address already in use" in text:
        return "address already in use; choose another endpoint with -l"
    inner = _INNER.search(text)
    return inner[1] if inner else text
