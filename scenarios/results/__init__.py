"""Figures, events and summary of a run, live, in virtual time or from its log.

stream            values derived from the messages once, for all who need them
metrics           figures gathered message by message
vehicles/         figures of single vehicles
channel/          what links did, against what was requested
events/           collisions, near misses, lane departures, paths lost, slides, stops, distrust
holes             poses that were not recorded
deviations        true errors and gaps for plots of the log
limits/           limits of the scenario that were kept or broken
files             names of the files of a run
versions          versions of the packages that ran it
summary           the typed summary, its JSON, and the documentation of its fields
summing_up        figures put together as a summary, and its file
log_summary       summary and scenario from a log alone
drives            what each vehicle drove, as arrays
inquiry/          questions put to a log
pictures/         the picture of a run and of its log
"""
