"""Directed links, in the receiving node, and the messages they deliver.

laws             impairments, one class each
link             verdict of one link on one message
content_stage    alteration of the content of messages
staged_messages  messages of a link that affect each other
gate             checks of received poses
positions        recent positions of the receiver
inbox            messages of one vehicle, tick by tick
true_poses       true poses of a vehicle, for an on-board sensor of another
"""
