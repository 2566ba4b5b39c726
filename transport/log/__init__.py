"""The MCAP log of a run, written during the run and read back.

writer            writes messages, each with its standard twins
reader            reads messages, metadata and attachments
foxglove          standard messages made of our own
scene             cars and road as Foxglove's scene entities
foxglove_layout   layout for a log in Foxglove
mcap_file         the readable records of a file
records           records of a file that may break off or be damaged
repair            completes a file that breaks off
"""
