"""The command line: `convoy COMMAND …`.

main       all commands, and `convoy` itself
running/   run, router, vehicle, record: drive a convoy, or its parts by hand
channel/   channels: a law against a sample, fitted ones, what is asked and known
control/   a convoy that drives: change it, look at it, make a scenario of what was done
guide/     completion of the shell, what a scenario asks for
many/      answers from many runs: drill, worst, sweep, bisect, risk, blame
scenario   list, check, new: look at scenarios
logs       review, report, explain: look at logs
study      gains, reproduce: look at the science
options    options that several commands share
tables     the tables printed at the end
columns    columns of a table as data, and what renders them
loading    how many modules are imported
output     standard output and error that end no run
failure    errors as clear lines and exit codes
"""
