"""Keys of a link whose laws are not tables themselves yet.

radio    what its radio receives over a distance
content  what it does to the content and the number of messages
"""
