"""What a scenario file may say of a link, table by table.

loss     laws of loss
delay    laws of delay, and its queue
outages  when and where it carries nothing
radio    what its radio receives over a distance
content  what it does to the content and the number of messages
"""
