"""All plug-in points."""

from scenarios.definition.schema.plug_ins.following import LONGITUDINAL
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from scenarios.definition.schema.plug_ins.steering import LATERAL

POINTS: tuple[PlugInPoint, ...] = (LATERAL, LONGITUDINAL)
