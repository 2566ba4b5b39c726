"""What a run was, live, in virtual time or from its log.

metrics           figures gathered message by message
figures           what is kept of one vehicle
channel/          what links did, against what was asked
degradation/      what followers did when messages failed
events/           all that must not pass unseen: collisions, lane departures, paths lost, stops
deviations        true errors and gaps for plots of the log
limits            which limits of the scenario were broken
recorded_numbers  which messages were recorded, by their numbers
holes             what was not recorded
files             names of the files of a run
versions          versions of what drove it
summary           the typed summary, and its JSON
meanings          what its fields mean
log_summary       summary and scenario from a log alone
drives            what each vehicle drove, as arrays
inquiry/          questions put to a log
pictures/         the picture of a run and of its log
"""
