"""What followers had to do by an instant.

deadlines  limits of modes, sources and recoveries, watched message by message
"""
