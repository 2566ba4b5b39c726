"""Every law that a scenario file can request of a link, by its key: a new law is a line here.

Where a key has laws of several kinds, the `kind` of its table tells which.
"""

from typing import Annotated

from pydantic import Field

from transport.links.laws.delay.constant import ConstantDelay
from transport.links.laws.delay.empirical import EmpiricalDelay
from transport.links.laws.delay.gamma import GammaDelay
from transport.links.laws.delay.lognormal import LognormalDelay
from transport.links.laws.delay.normal import NormalDelay
from transport.links.laws.delay.uniform import UniformDelay
from transport.links.laws.loss.earlier_run import EarlierRun
from transport.links.laws.loss.every_nth import EveryNth
from transport.links.laws.loss.four_state import FourState
from transport.links.laws.loss.gilbert_elliott import GilbertElliott
from transport.links.laws.loss.listed import Listed
from transport.links.laws.loss.none import NoLoss
from transport.links.laws.loss.pattern import RecordedPattern
from transport.links.laws.outages.circle import CircleOutage
from transport.links.laws.outages.random import RandomOutage
from transport.links.laws.outages.stretch import StretchOutage
from transport.links.laws.outages.window import WindowOutage
from transport.links.laws.radio.path_loss import PathLossRadio
from transport.links.laws.radio.table import TableRadio

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
