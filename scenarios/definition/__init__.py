"""Scenario files: read, validated and resolved.

library          scenario files as text: shipped ones, the template, and the user's
extends          a file merged into the one that it extends
overrides        `--set`, applied to both
schema/          the tables of a file: keys with units, defaults and limits
errors           the exceptions of invalid scenarios
validation/      their lines, with hints
contradictions   keys that contradict each other
plug_in_trials   classes selected by name are called before the run
topology         information flow: the vehicles that each vehicle receives
channel/         the settings of each directed link, and its effects
run_limits       limits of a run, from a scenario or the command line
changing/        changes to a running convoy, scheduled and by hand
traces/          recorded drives
recorded_messages  the log of replayed vehicles
road/            the lead's path and speed, and where each vehicle starts
vehicle_setup    one vehicle: its own tables merged into the convoy's
scenario         a valid scenario
check/           figures and warnings before a run
"""
