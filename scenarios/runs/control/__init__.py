"""Control of a running convoy from outside.

run_id            queries that name their run
open_runs         the runs of this user on this machine, and where to join them
live_control      a vehicle that answers requests for changes
run_status        the status of a run, as its recorder reports it
end_confirmation  each vehicle confirms the end of a completed run
"""
