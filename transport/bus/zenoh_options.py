"""Options of a Zenoh session: the usual flags of Zenoh's tools, and the convoy's defaults."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

# Defaults where neither the user's file nor a flag sets a value, as JSON5 texts.
DEFAULTS = {
    "mode": '"client"',
    # Convoys on the same network do not connect by accident.
    "scouting/multicast/enabled": "false",
    # Peers that discover each other by gossip open one link, not two.
    "scouting/gossip/autoconnect_strategy": '{peer: {to_peer: "greater-zid"}}',
    # Poses are small; shared memory would leave files in /dev/shm.
    "transport/shared_memory/enabled": "false",
    # 16 batches of 64 KiB: a burst of 2000 messages passes without loss. With Zenoh's default of
    # 2, one burst in ten loses messages.
    "transport/link/tx/queue/size/data": "16",
    "transport/link/tx/queue/size/data_high": "16",
    # A connection may take this time (ms), on a slow path that loses packets too.
    "transport/unicast/open_timeout": "30000",
    "transport/unicast/accept_timeout": "30000",
    # Reconnect within 0.3 s of a router's return; Zenoh's default waits up to 4 s.
    "connect/retry": "{period_init_ms: 100, period_max_ms: 500, period_increase_factor: 1.5}",
    # A process that is silent for 10 s is disconnected; the end of a process is reported at once.
    # With 2 s, a router frozen for 4 s disconnected every vehicle when it resumed, and each lost 80
    # poses; with 10 s, a cut of 3 s loses nothing (measured).
    "transport/link/tx/lease": "10000",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ZenohOptions:
    """Options of a session, as the flags of Zenoh's tools.

    mode               client (of a router) or peer; None: that of `config`, else client
    connect, listen    endpoints such as tcp/127.0.0.1:7447; empty: those of `config`
    config             Zenoh configuration file (JSON5)
    cfg                settings KEY:VALUE, the value in JSON5; override everything else
    run                name of the run, the prefix of every key on the wire (Zenoh's `namespace`);
                       runs with other names are invisible
    connect_timeout_s  timeout of connecting to a router
    """

    mode: Literal["client", "peer"] | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    config: Path | None = None
    cfg: tuple[str, ...] = ()
    run: str = ""
    connect_timeout_s: float = 5.0
