"""Hundreds of runs, on the cores of this machine or on an engine that is there already.

job      one piece of work, and what a worker makes of several of them
stamp    which programs a worker has: results of different ones are not mixed
fleet    who does the work: this process, a pool of processes, a dask scheduler's workers
engine   runs the jobs of a study, each once, however often workers and driver are killed
journal  results as they come, in a file that outlives the driver
results  files of a study: tables, JSON, pictures, each written whole
"""
