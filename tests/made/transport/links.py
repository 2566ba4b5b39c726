"""Links as a scenario configures them, for tests of deliveries."""

from collections.abc import Mapping

from scenarios.definition.channel.build import UNSET, content_stage, link_effects, link_stages
from scenarios.definition.schema.link_tables import LinkTable
from transport.links.inbox import Inbox, IncomingLink
from transport.links.laws.link_law import UNKNOWN_POSITION, LinkSetting, Position
from transport.links.link import Link, PoseGate
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.messages import GpsPose


def link(
    requested: LinkTable,
    sender: str = "lead",
    receiver: str = "follower_1",
    *,
    seed: int = 1,
    rate_hz: float = 20.0,
    setting: LinkSetting = UNSET,
) -> Link:
    effects = link_effects(requested, rate_hz, setting)
    return Link(effects, seed, sender, receiver, link_stages(requested))


def inbox(
    receiver: str,
    requested: Mapping[str, LinkTable],
    *,
    start_at: int,
    seed: int = 1,
    rate_hz: float | Mapping[str, float] = 20.0,
    origin: Origin | None = None,
) -> Inbox:
    plane = LocalPlane(origin or Origin(37.72, -122.47, 30.0))
    rates = rate_hz if isinstance(rate_hz, Mapping) else dict.fromkeys(requested, rate_hz)
    links = []
    for sender, table in requested.items():
        incoming = link(table, sender, receiver, seed=seed, rate_hz=rates[sender])
        gate = PoseGate(sender=sender, start_at=start_at, rate_hz=rates[sender], plane=plane)
        links.append(IncomingLink(incoming, gate, content_stage(table.content, incoming, gate)))
    return Inbox(receiver, links, start_at=start_at)


def taken(inbox: Inbox, now: int, here: Position = UNKNOWN_POSITION) -> list[GpsPose]:
    """Messages delivered by an inbox at the tick at `now` (ns)."""
    return [pose.message for pose in inbox.take(now, here)]
