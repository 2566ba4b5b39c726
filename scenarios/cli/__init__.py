"""The command line: `convoy COMMAND …`.

main       all commands, and `convoy` itself
run        run, router, vehicle, record: drive a convoy, or its parts by hand
running    what run and record do: folder, listeners, summary
channel/   channels: what they cost
guide/     completion of the shell, what a scenario asks for
scenario   list, check, new: look at scenarios
logs       review, report, explain: look at logs
study      gains, reproduce: look at the science
options    options that several commands share
progress   the live table of a run
tables     the tables printed at the end
channel_tables   what links did, and what a vehicle knew
failure    errors as clear lines and exit codes
"""
