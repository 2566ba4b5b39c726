"""The MCAP log of a run, written as it happens and read back.

writer            messages in, each with its standard twins
reader            messages, metadata and attachments out
foxglove          standard messages made of our own
scene             cars and road as Foxglove's scene entities
foxglove_layout   layout for a log in Foxglove
mcap_file         the file beneath, as far as it can be read
records           records of a file that may break off or be damaged
repair            a file that breaks off gets its end
"""
