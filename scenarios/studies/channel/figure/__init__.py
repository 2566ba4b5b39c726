"""`convoy channel figure`: what loss, its bursts and latency cost the last vehicle of a convoy.

drives   drives over many channels, and what each cost
picture  them drawn
figure   both, and JSON, in a folder
"""
