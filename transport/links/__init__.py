"""Directed links in the receiver, and what comes through them.

laws        the impairments, each an effect of its own
link        the verdict of one link on one message
arrival     what the channel makes of a message's content: copies, wrong bits, falsehoods
line        what a link's messages do to one another
gate        which poses can be true at all
places      the places that the receiver passed
inbox       what one vehicle receives, tick by tick
"""
