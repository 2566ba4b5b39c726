"""The command line: `convoy COMMAND …`.

main               the group of all commands
grouped_help       its help under headings, usage errors
running/           run, router, vehicle, record
live/              commands for a running convoy
comparing/         commands that compare runs
tables/            export, runs
many/              commands that simulate many runs
channel/           channel show, fit
reference/         the pages of convoy reference
guide/             shell completion, and the table of convoy check
scenario_commands  list, check, new
logs/              info, recover
log_commands       review, report, explain
paper_commands     gains, reproduce
common_options     options that several commands share
summary_tables     the tables printed after a run
display_options    what a run displays and prints
columns            columns of a table as data, and their rendering
output             standard output and error that never end a run
error_lines        errors as lines and exit codes
"""
