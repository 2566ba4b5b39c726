"""Hundreds of runs, on the cores of this machine or on an engine that is there already.

job      one piece of work, and a batch of them on a worker
stamp    the versions of a worker's programs: results of different ones are not mixed
fleet    the workers: this process, a pool of processes, or those of a dask scheduler
driver   hands out the jobs in batches and survives the workers
journal  results as they come, in a file that outlives the driver
results  files of a study: tables, JSON, pictures, each written whole
engine   runs the jobs of a study, each once, however often workers and driver are killed
"""
