"""The command line: `convoy COMMAND …`.

main            all commands, and `convoy` itself
running/        run, router, vehicle, record: drive a convoy, or its parts by hand
channel/        channels: a law against a sample, fitted laws, costs, what a vehicle knew
control/        a convoy that drives: change it, look at it, make a scenario of what was done
guide/          completion of the shell, the configuration of a scenario
many/           answers from many runs: drill, worst, sweep, bisect, risk, blame
scenario        list, check, new: look at scenarios
logs            review, report, explain: look at logs
study           gains, reproduce: look at the science
options         options that several commands share
summary_tables  the tables printed at the end
columns         columns of a table as data, and what renders them
output          standard output and error that never end a run
failure         errors as clear lines and exit codes
"""
