"""What a run was, live, in virtual time or from its log.

metrics           figures gathered message by message
figures           what is kept of one vehicle
channel/          what links did, against what was asked
degradation/      what followers did when messages failed
events/           all that must not pass unseen: collisions, lane departures, paths lost, stops
deviations        true errors and gaps for plots of the log
limits            which limits of the scenario were broken
completeness/     what was recorded, and what was not
files             names of the files of a run
versions          versions of what drove it
summary           the typed summary, and its JSON
meanings          what its fields mean
summing_up        figures put together as a summary, and its file
log_summary       summary and scenario from a log alone
drives            what each vehicle drove, as arrays
inquiry/          questions put to a log
pictures/         the picture of a run and of its log
"""
