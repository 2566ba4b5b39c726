"""One run of a scenario: in processes over Zenoh, or in virtual time.

node/        one vehicle, the same on the wall clock and in virtual time
processes/   a process per vehicle, router, recorder, and what keeps them together
control/     a convoy that drives, found, looked at and changed by hand
virtual/     all vehicles in one process, as fast as it goes
limit_watch  ends a run early when a limit requires it
observer     who receives the messages of a run
recorder     every message into log, figures and picture
watchers     who watches a run, and waits while the log has to catch up
run_folder   the folder of a run, taken by one at a time
run_log      the two files of a run
stop         why and how a process has to stop; exit codes
"""
