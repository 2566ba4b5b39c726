"""One run of a scenario: in processes over Zenoh, or in virtual time.

node/           one vehicle, the same on the wall clock and in virtual time
processes/      a process per vehicle, router and recorder, and their supervision
control/        find, observe and change a running convoy
virtual/        all vehicles in one process, as fast as possible
machine         what a process uses of its machine
limit_watch     ends a run early when a limit requires it
observer        receivers of the messages of a run, and those that yield to a late log
progress_lines  progress as a line of text every few seconds
recorder        writes every message into log, figures and picture
run_folder      the folder of a run, locked for one run at a time
run_log         log and summary of a run
stop            requests to stop a process; exit codes
"""
