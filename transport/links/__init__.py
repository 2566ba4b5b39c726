"""Directed links in the receiver, and what comes through them.

laws        the impairments, each an effect of its own
link        the verdict of one link on one message
arrival     a message on its link, and what the channel makes of its content
line        what a link's messages do to one another
gate        which messages can be poses at all
places      the places that the receiver passed
inbox       what one vehicle receives, tick by tick
"""
