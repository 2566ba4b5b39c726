"""Laws on one link of a run, with parameters in the order of the literature."""

from typing import TypeVar

from transport.links.laws.burst_losses import FourState, GilbertElliott
from transport.links.laws.link_law import Effect, LinkLaw, LinkSetting
from transport.links.laws.outages import (
    AffectedVehicle,
    CircleOutage,
    RandomOutage,
    SpanOutage,
    StretchOutage,
    WindowOutage,
)
from transport.links.laws.shared_channel import Collisions
from vehicles.schedule import SECOND

SomeLaw = TypeVar("SomeLaw", bound=LinkLaw)


def for_link(law: SomeLaw, setting: LinkSetting | None = None) -> SomeLaw:
    """First effect of the law on a link; raises ValueError if its keys do not fit."""
    for key, problem in law.problems():
        raise ValueError(f"{key}: {problem}")
    effect = law.effects(setting or LinkSetting())[0]
    assert isinstance(effect, type(law))
    return effect


def long_run(effect: Effect) -> tuple[float | None, float | None]:
    losses = effect.losses(None)
    return (None, None) if losses is None else (losses.loss, losses.burst)


def gilbert_elliott(p: float, r: float, h: float = 0.0, k: float = 1.0) -> GilbertElliott:
    return for_link(
        GilbertElliott(
            good_to_bad_ratio=p, bad_to_good_ratio=r, bad_delivered_ratio=h, good_delivered_ratio=k
        )
    )


def gilbert(loss: float, burst: float) -> GilbertElliott:
    return for_link(GilbertElliott(loss_ratio=loss, burst_messages_mean=burst))


def four_state(
    p13: float, p31: float, p32: float = 0.0, p23: float = 1.0, p14: float = 0.0
) -> FourState:
    return for_link(
        FourState(
            gap_to_burst_ratio=p13,
            burst_to_gap_ratio=p31,
            lost_to_sent_ratio=p32,
            sent_to_lost_ratio=p23,
            isolated_loss_ratio=p14,
        )
    )


def collisions(loss: float, keep: float = 0.0, least: int = 5, most: int = 15) -> Collisions:
    return for_link(
        Collisions(
            loss_ratio=loss,
            keep_ratio=keep,
            reselection_messages_min=least,
            reselection_messages_max=most,
        )
    )


def window(
    start: int, end: int, start_at: int, every: int = 0, kind: type[SpanOutage] = WindowOutage
) -> SpanOutage:
    """From `start` to `end` ns after `start_at`, repeated every `every`."""
    law = kind(from_s=start / SECOND, to_s=end / SECOND, every_s=every / SECOND if every else None)
    return for_link(law, LinkSetting(start_at=start_at))


def stretch(
    ends_m: tuple[float, float],
    vehicle: AffectedVehicle,
    sender: float,
    receiver: float,
    every_m: float | None = None,
) -> StretchOutage:
    law = StretchOutage(from_m=ends_m[0], to_m=ends_m[1], vehicle=vehicle, every_m=every_m)
    return for_link(law, LinkSetting(sender_station=sender, receiver_station=receiver))


def circle(east: float, north: float, radius: float, vehicle: AffectedVehicle) -> CircleOutage:
    return for_link(CircleOutage(east_m=east, north_m=north, radius_m=radius, vehicle=vehicle))


def random_outage(on: int, off: int, start_at: int, place: int = 0) -> RandomOutage:
    """From the mean times on and off (ns)."""
    law = RandomOutage(mean_on_s=on / SECOND, mean_off_s=off / SECOND)
    return for_link(law, LinkSetting(start_at=start_at, place=place))
