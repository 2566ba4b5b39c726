"""Sending rules by the `kind` of the table `[sending]`. Register new rules here."""

from collections.abc import Mapping

from vehicles.car.sending.awareness import AwarenessMessages
from vehicles.car.sending.every_fix import EveryFix
from vehicles.car.sending.fixed_rate import FixedRate
from vehicles.car.sending.intervals import MeasuredIntervals
from vehicles.car.sending.profile import RateProfile
from vehicles.car.sending.rule import SendingRule

RULES: Mapping[str, type[SendingRule]] = {
    "every_fix": EveryFix,
    "fixed": FixedRate,
    "profile": RateProfile,
    "cam": AwarenessMessages,
    "intervals": MeasuredIntervals,
}
