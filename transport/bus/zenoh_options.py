"""How a process joins Zenoh: the usual flags of Zenoh's own tools, and the convoy's defaults."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

# They hold where neither the user's file nor a flag says otherwise. Each value is JSON5 text.
DEFAULTS = {
    "mode": '"client"',
    # Two convoys on the same network do not find each other by accident.
    "scouting/multicast/enabled": "false",
    # Two peers that know each other by gossip open one link, not two.
    "scouting/gossip/autoconnect_strategy": '{peer: {to_peer: "greater-zid"}}',
    # Poses are small; shared memory would leave files in /dev/shm behind.
    "transport/shared_memory/enabled": "false",
    # Sixteen batches of 64 KiB, taken as needed: a burst of 2000 messages passes without loss,
    # where the two of the default lost a part in every tenth.
    "transport/link/tx/queue/size/data": "16",
    "transport/link/tx/queue/size/data_high": "16",
    # Back within 0.3 s after a router is (the default waits up to 4 s).
    "connect/retry": "{period_init_ms: 100, period_max_ms: 500, period_increase_factor: 1.5}",
}
# How soon a process that hangs is cut off and missed; one that ends is missed at once. Only of a
# vehicle it has to be known soon. A recorder that is held up must lose nothing meanwhile, and a
# router keeps Zenoh's 10 s, too: with 2 s it would cut off those that are slow to hear from it.
VEHICLE_DEFAULTS = {"transport/link/tx/lease": "2000"}
RECORDER_DEFAULTS = {"transport/link/tx/lease": "10000"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ZenohOptions:
    """How to join, in Zenoh's usual terms (the flags of its own tools).

    mode               client (of a router) or peer; None leaves it to `config`, else client
    connect, listen    endpoints such as tcp/127.0.0.1:7447; empty leaves them to `config`
    config             a Zenoh configuration file (JSON5)
    cfg                settings KEY:VALUE, the value in JSON5; they go over everything else
    run                name of the run, which goes before every key on the wire (Zenoh's
                       `namespace`); runs of other names are neither heard nor seen
    connect_timeout_s  how long to try to reach a router before giving up
    """

    mode: Literal["client", "peer"] | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    config: Path | None = None
    cfg: tuple[str, ...] = ()
    run: str = ""
    connect_timeout_s: float = 5.0
