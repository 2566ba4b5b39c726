"""The MCAP log of a run, written as it happens and read back.

message_log       what a run asks of its log
writer            messages in, each with its standard twins
aside/            the same, but another process writes the file
reader            messages, metadata and attachments out
foxglove          standard messages made of our own
scene             cars and road as Foxglove's scene entities
foxglove_layout   layout for a log in Foxglove
mcap_file         the file beneath, as far as it can be read
records           records of a file that may break off or be damaged
repair            a file that breaks off gets its end
fast_mcap         a shorter way to write very many messages
packed_messages   those of a chunk, packed as they will be written
"""
