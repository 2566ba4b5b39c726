"""Commands for a running convoy.

live_commands    link, cut, gnss, stall, crash, speed, status, scenario-from
change_requests  requests to the vehicles of a run, and their answers
status_tables    the status of a run as tables
"""
