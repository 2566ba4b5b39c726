"""Figures, events and summary of a run, live, in virtual time or from its log.

stream        values derived once from the messages, for all subscribers
metrics       gathers the figures of a run
vehicles/     figures of single vehicles
channel/      achieved against requested behaviour of links
events/       collisions, near misses, lane departures, paths lost, slides, stops, distrust
run_changes   changes to a running convoy, as the summary lists them
holes         missing poses in the log
deviations    true errors and gaps for plots of the log
limits/       results of the scenario's limits
files         names of the files of a run
versions      versions and digests of the program and of user-defined classes
outcome       the outcome of a run in one line
summary       the typed summary, its JSON, and the documentation of its fields
summarise     figures put together as a summary, and its file
log_summary   summary and scenario from a log alone
drives        the drive of each vehicle as arrays
recorded/     a log as tables, by vehicle and link
log_queries/  explain an instant, repeat a session
report/       the report of a run as one HTML file
pictures/     the picture of a run and of its log
"""
