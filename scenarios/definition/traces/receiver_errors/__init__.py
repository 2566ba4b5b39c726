"""Errors of a receiver in a recorded drive.

jump_suspects  points at which a jump may begin
jumps          outliers
stands         standstills with a drifting position
"""
