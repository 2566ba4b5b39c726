"""What a scenario says: read, refused in clear lines, or resolved.

library          scenario files as text: shipped ones and the user's
extends          a file laid over the one that it extends
overrides        `--set` laid over both
renamed          old names of keys and values
schema/          the tables of a file: keys with units, defaults and limits
contradictions   keys that do not fit one another
refusal          what is wrong, in one line each
errors           the exceptions that carry those lines
links            who listens to whom
channel/         what is asked of each directed link, and the effects that follow
limits           limits of a run, from a scenario or the command line
changing/        changes to a running convoy, scheduled and by hand
traces/          the lead's recorded drive
road/            the lead's path and speed, and where each vehicle starts
vehicle_setup    one vehicle: its own tables laid over the convoy's
scenario         all of it: a valid scenario
template         the commented scenario of `convoy new`
check/           figures and warnings before a run
"""
