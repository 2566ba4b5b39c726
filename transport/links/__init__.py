"""Directed links in the receiver, and the messages that they deliver.

laws        the impairments, one class each
link        the verdict of one link on one message
arrival     a message on its link, and false content
line        stages, in which a link's messages depend on one another
gate        checks whether a message can be a pose
positions   recent positions of the receiver
inbox       the messages of one vehicle, tick by tick
"""
