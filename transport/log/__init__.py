"""The MCAP log of a run.

writer           writes messages, each with its standard Foxglove messages
reader           reads messages, metadata and attachments
columns          reads messages as arrays by field
wire             decodes the fields of many messages at once
location_fixes   reads positions of other programs' files
foxglove         standard Foxglove messages made from ours
scene            cars and road as Foxglove scene entities
foxglove_layout  layout of a log for Foxglove
mcap_file        readable records of a file, and logs written again
errors           errors of logs
"""
