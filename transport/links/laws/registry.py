"""All laws that a scenario file can request for a link, by key; a new law is one line here.

If a key has laws of several kinds, the `kind` of its table selects one.
"""

from collections.abc import Mapping
from typing import Annotated, Any, get_args

from pydantic import Field

from transport.links.laws.basic import Decimation, Loss, Queue
from transport.links.laws.burst_losses import FourState, GilbertElliott
from transport.links.laws.content import ContentLaw
from transport.links.laws.delays import (
    ConstantDelay,
    EmpiricalDelay,
    GammaDelay,
    LognormalDelay,
    NormalDelay,
    UniformDelay,
)
from transport.links.laws.link_law import Effect
from transport.links.laws.outages import (
    CircleOutage,
    RandomOutage,
    ReceiverOff,
    StretchOutage,
    TransmitterOff,
    WindowOutage,
)
from transport.links.laws.radio import PathLossRadio
from transport.links.laws.recorded_losses import (
    EarlierRun,
    EveryNth,
    Listed,
    NoLoss,
    RecordedPattern,
)
from transport.links.laws.shared_channel import Collisions, TableRadio

# fmt: off
LossLaw = Annotated[
    NoLoss
    | GilbertElliott
    | FourState
    | EveryNth
    | Listed
    | RecordedPattern
    | EarlierRun,
    Field(discriminator="kind"),
]
DelayLaw = Annotated[
    ConstantDelay
    | UniformDelay
    | NormalDelay
    | LognormalDelay
    | GammaDelay
    | EmpiricalDelay,
    Field(discriminator="kind"),
]
OutageLaw = Annotated[
    WindowOutage
    | StretchOutage
    | CircleOutage
    | RandomOutage,
    Field(discriminator="kind"),
]
RadioLaw = Annotated[
    TableRadio
    | PathLossRadio,
    Field(discriminator="kind"),
]
# fmt: on


def _kinds(laws: Any) -> tuple[type[Effect], ...]:
    kinds: tuple[type[Effect], ...] = get_args(get_args(laws)[0])
    return kinds


LAWS: Mapping[str, tuple[type[Effect], ...]] = {
    "rate_hz": (Decimation,),
    "transmitter_off": (TransmitterOff,),
    "receiver_off": (ReceiverOff,),
    "outages": _kinds(OutageLaw),
    "loss_ratio": (Loss,),
    "loss": _kinds(LossLaw),
    "collisions": (Collisions,),
    "radio": _kinds(RadioLaw),
    "queue": (Queue,),
    "content": (ContentLaw,),
}
"""Laws that drop messages by their key, in the order of judging."""
KEY_OF_REASON: Mapping[str, str] = {
    law.reason: key for key, laws in LAWS.items() for law in laws if law.reason is not None
}
"""Key of a link or vehicle by the reason of its drops, in the same order."""
