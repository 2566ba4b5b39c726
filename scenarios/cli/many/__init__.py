"""Answers from many runs, on the command line.

options  options that these commands share
bisect   convoy bisect
risk     convoy risk
"""
