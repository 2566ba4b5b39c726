"""The two files of a run's folder; the summary is also attached to the log."""

LOG_NAME = "run.mcap"
SUMMARY_NAME = "summary.json"
