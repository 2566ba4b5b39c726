"""What followers did about messages that did not come, or that could not be true.

deadlines  what they had to have done by an instant
reaction   modes, recoveries, stops and metres driven blind of one follower
"""
