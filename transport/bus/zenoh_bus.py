"""The bus over Eclipse Zenoh: the only module that knows it.

A star is the ordinary shape: one router and every process a client of it. A router does not
forward between two peers, so peers need each other's endpoints (or gossip through a third).
"""

import json
import logging
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import zenoh

from transport.bus.bus import AliveHandler, BusError, Closing, Handler
from transport.bus.zenoh_options import DEFAULT_ENDPOINT, DEFAULTS, MEMBER_DEFAULTS, ZenohOptions
from transport.topics import TOPICS, alive_key

__all__ = ["DEFAULT_ENDPOINT", "Router", "ZenohBus", "ZenohOptions", "open_bus", "open_router"]

FLUSH_S = 1.0
"""At most so long does closing wait until what was published has reached the router."""

_SLICE_S = 1.0
_SETTLE_S = 0.01
"""A lost router shows in `connected()` within 3 ms of the deaths it feigns (measured, idle)."""

logger = logging.getLogger(__name__)
_SOURCE_LINE = re.compile(r" at /\S+?\.rs:\d+\.?")
_INNER = re.compile(r'(?:Str\(|msg: )"(.*?)"[,)]')


class ZenohBus(Closing):
    """A session of one process; open it with `open_bus` and close it with `with`.

    An unclosed session would keep the interpreter from exiting, also after an exception.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[tuple[str, bool], zenoh.Publisher] = {}
        self._kept: list[object] = []  # subscribers and tokens end when they are let go of
        self._announced: set[str] = set()

    @property
    def zid(self) -> str:
        """The session's identifier, as Zenoh's own tools print it."""
        return str(self._session.zid())

    def connected(self) -> bool:
        """Say whether a router or peer is linked to this process.

        When the router goes, every vehicle seems to die at once; then this is False.
        """
        return bool(self._session.info.transports())

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        """Send `data` under `key`; never blocks for a slow or absent receiver."""
        publisher = self._publishers.get((key, urgent))
        if publisher is None:
            publisher = self._publishers[key, urgent] = self._declare(key, urgent=urgent)
        try:  # no `with` here, where a vehicle comes by two hundred times a second
            publisher.put(data)
        except zenoh.ZError as error:
            raise BusError(f"cannot publish {key}: {_reason(error)}") from None

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call `handler`, on a thread of its own, for every message whose key matches."""

        def hear(sample: zenoh.Sample) -> None:
            try:
                handler(str(sample.key_expr), sample.payload.to_bytes())
            except Exception:  # a handler's fault must not end the subscription for good
                logger.exception("handler of %s failed", key_expression)

        with _one_line(f"cannot subscribe {key_expression}"):
            self._kept.append(self._session.declare_subscriber(key_expression, hear))

    def announce(self, vehicle: str) -> None:
        """Say that `vehicle` is alive, until this bus closes or its process dies."""
        if vehicle in self._announced:
            return
        with _one_line(f"cannot announce {vehicle}"):
            self._kept.append(self._session.liveliness().declare_token(alive_key(vehicle)))
        self._announced.add(vehicle)

    def watch(self, handler: AliveHandler) -> None:
        """Call `handler` for every vehicle that is, becomes or ceases to be alive.

        What Zenoh says twice is passed on once. When the router is lost every vehicle is reported
        dead and `connected()` is False by then, on a busy machine some milliseconds later; those
        that live are reported again once it is back.
        """
        alive: set[str] = set()

        def hear(sample: zenoh.Sample) -> None:
            vehicle = str(sample.key_expr).split("/")[1]
            lives = sample.kind == zenoh.SampleKind.PUT
            if lives == (vehicle in alive):
                return
            (alive.add if lives else alive.discard)(vehicle)
            if not lives and self.connected():
                time.sleep(_SETTLE_S)
            try:
                handler(vehicle, lives)
            except Exception:  # as above
                logger.exception("handler of liveliness failed")

        with _one_line("cannot watch liveliness"):
            self._kept.append(
                self._session.liveliness().declare_subscriber(alive_key("*"), hear, history=True)
            )

    def close(self) -> None:
        """Wait until the router has what was published, then leave."""
        if self._session.is_closed():
            return
        # Closing drops what still waits in the queue. A query that nobody answers waits behind it
        # and comes back when the router has read it all.
        nobody = f"convoy/@flush/{self.zid}"
        try:
            list(self._session.get(nobody, priority=zenoh.Priority.DATA, timeout=FLUSH_S))
        except zenoh.ZError:
            logger.debug("nothing to flush to")
        self._publishers.clear()
        self._kept.clear()
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it

    def _declare(self, key: str, *, urgent: bool) -> zenoh.Publisher:
        topic = TOPICS.get(key.rpartition("/")[2])
        encoding = zenoh.Encoding.APPLICATION_PROTOBUF
        with _one_line(f"cannot publish {key}"):
            return self._session.declare_publisher(
                key,
                encoding=encoding.with_schema(f"convoy.{topic.message.__name__}")
                if topic
                else encoding,
                congestion_control=zenoh.CongestionControl.DROP,
                # Not "express": ten poses of one instant would each fill a place of the queue.
                priority=zenoh.Priority.DATA_HIGH if urgent else zenoh.Priority.DATA,
            )


class Router(Closing):
    """A Zenoh router in this process, until closed; `endpoints` are those it listens on."""

    def __init__(self, session: zenoh.Session, endpoints: tuple[str, ...]) -> None:
        self._session = session
        self.endpoints = endpoints
        self.zid = str(session.zid())

    def occupied(self) -> bool:
        """Say whether anyone is linked to this router."""
        return bool(self._session.info.transports())

    def close(self) -> None:
        """Stop routing."""
        if not self._session.is_closed():
            self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


def open_bus(options: ZenohOptions) -> ZenohBus:
    """Join the convoy's network; raises BusError with one line that says what is wrong."""
    config = configuration(options, DEFAULTS | MEMBER_DEFAULTS)
    zenoh.init_log_from_env_or("error")
    if config.get_json("mode") != '"client"':
        # A peer that finds nobody opens all the same: the others may come later.
        with _one_line("cannot open a peer"):
            return ZenohBus(zenoh.open(config))
    endpoints = config.get_json("connect/endpoints").strip("[]").replace('"', "")
    if not endpoints:
        raise BusError(f"a client needs a router to connect to, such as {DEFAULT_ENDPOINT}")
    patience = f"{options.connect_timeout_s:g} s"
    with _one_line(f"cannot join through {endpoints} within {patience}; is a router there?"):
        return ZenohBus(_patiently(config, options.connect_timeout_s))


def _patiently(config: zenoh.Config, timeout_s: float) -> zenoh.Session:
    """Open a client, in slices of time, so that signals are heard in between."""
    give_up_at = time.monotonic() + timeout_s
    while True:
        left_s = min(give_up_at - time.monotonic(), _SLICE_S)
        config.insert_json5("connect/timeout_ms", str(max(1, round(left_s * 1000))))
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if time.monotonic() >= give_up_at:
                raise


def open_router(
    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,),
    *,
    config: Path | None = None,
    cfg: tuple[str, ...] = (),
) -> Router:
    """Start a router; port 0 picks a free one. Raises BusError, for one when a port is taken."""
    options = ZenohOptions(listen=listen, config=config, cfg=cfg)
    # Nobody is scouted for, so there is no use in waiting half a second for answers.
    chosen = configuration(options, DEFAULTS | {"scouting/delay": "0"})
    _insert(chosen, "mode", '"router"')
    ask = any(endpoint.endswith(":0") for endpoint in listen)
    if ask:
        _insert(chosen, "adminspace/enabled", "true")
    zenoh.init_log_from_env_or("error")
    with _one_line(f"cannot listen on {', '.join(listen)}"):
        session = zenoh.open(chosen)
        return Router(session, _locators(session) if ask else listen)


def _locators(session: zenoh.Session) -> tuple[str, ...]:
    for reply in session.get(f"@/{session.zid()}/router"):
        if reply.ok is not None:
            return tuple(json.loads(reply.ok.payload.to_bytes())["locators"])
    raise BusError("the router does not say where it listens")


def configuration(options: ZenohOptions, defaults: Mapping[str, str]) -> zenoh.Config:
    """Lay flags over the user's file over `defaults`; raises BusError for what Zenoh refuses."""
    given, pristine = zenoh.Config(), zenoh.Config()
    if options.config is not None:
        with _one_line(f"cannot read {options.config}"):
            given = zenoh.Config.from_file(options.config)
    for setting, value in defaults.items():
        if given.get_json(setting) == pristine.get_json(setting):
            _insert(given, setting, value)
    if options.mode is not None:
        _insert(given, "mode", json.dumps(options.mode))
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
    with _one_line(f"setting {setting}:{value}"):
        config.insert_json5(setting, value)


@contextmanager
def _one_line(what: str) -> Iterator[None]:
    """Turn Zenoh's errors into BusError, in one line and without its source files."""
    try:
        yield
    except zenoh.ZError as error:
        raise BusError(f"{what}: {_reason(error)}") from None


def _reason(error: zenoh.ZError) -> str:
    text = " ".join(_SOURCE_LINE.sub("", str(error)).split())
    inner = _INNER.search(text)
    return inner[1] if inner else text
