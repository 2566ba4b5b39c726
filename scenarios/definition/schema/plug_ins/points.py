"""All plug-in points."""

from scenarios.definition.schema.plug_ins.channel import DELAY, LOSS
from scenarios.definition.schema.plug_ins.emission import RECEIVER_ERROR, SENDING
from scenarios.definition.schema.plug_ins.following import LONGITUDINAL
from scenarios.definition.schema.plug_ins.measures import EVENT, FIGURE
from scenarios.definition.schema.plug_ins.path import FUSION, REACTION
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from scenarios.definition.schema.plug_ins.steering import LATERAL

POINTS: tuple[PlugInPoint, ...] = (
    LATERAL,
    LONGITUDINAL,
    FUSION,
    REACTION,
    LOSS,
    DELAY,
    SENDING,
    RECEIVER_ERROR,
    EVENT,
    FIGURE,
)
