"""Hundreds of runs, on the cores of this machine or on an engine that is there already.

fleet      who does the work: this process, a pool of processes, a dask scheduler's workers
driver     hands out the work in batches and survives the workers
batch      what one worker does in one go
stamp      which programs a worker has: results of different ones are not mixed
countdown  how far they are, and the time left
journal    results as they come, in a file that outlives the driver
"""
