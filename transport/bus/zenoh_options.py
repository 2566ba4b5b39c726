"""How a process joins Zenoh: the usual flags of Zenoh's own tools, and the convoy's defaults."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

# Defaults where neither the user's file nor a flag sets a value. Each value is JSON5 text.
DEFAULTS = {
    "mode": '"client"',
    # Two convoys on the same network do not find each other by accident.
    "scouting/multicast/enabled": "false",
    # Two peers that know each other by gossip open one link, not two.
    "scouting/gossip/autoconnect_strategy": '{peer: {to_peer: "greater-zid"}}',
    # Poses are small; shared memory would leave files in /dev/shm.
    "transport/shared_memory/enabled": "false",
    # Sixteen batches of 64 KiB: a burst of 2000 messages passes without loss (with the default of
    # two every tenth burst loses messages).
    "transport/link/tx/queue/size/data": "16",
    "transport/link/tx/queue/size/data_high": "16",
    # Reconnects within 0.3 s of a router's return (the default waits up to 4 s).
    "connect/retry": "{period_init_ms: 100, period_max_ms: 500, period_increase_factor: 1.5}",
}
# Time after which a process that hangs is disconnected and reported dead; one that ends is reported
# at once. Short for vehicles only: a recorder that is held up must lose nothing, and a router keeps
# Zenoh's 10 s, because with 2 s it would disconnect slow processes.
VEHICLE_DEFAULTS = {"transport/link/tx/lease": "2000"}
RECORDER_DEFAULTS = {"transport/link/tx/lease": "10000"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ZenohOptions:
    """How to join, in Zenoh's usual terms (the flags of its own tools).

    mode               client (of a router) or peer; None for that of `config`, else client
    connect, listen    endpoints such as tcp/127.0.0.1:7447; empty for those of `config`
    config             a Zenoh configuration file (JSON5)
    cfg                settings KEY:VALUE, the value in JSON5; they override everything else
    run                name of the run, the prefix of every key on the wire (Zenoh's `namespace`);
                       runs of other names are invisible
    connect_timeout_s  longest time to try to reach a router
    """

    mode: Literal["client", "peer"] | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    config: Path | None = None
    cfg: tuple[str, ...] = ()
    run: str = ""
    connect_timeout_s: float = 5.0
