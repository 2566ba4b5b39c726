"""Hundreds of runs, on the cores of this machine or on a running dask scheduler.

job      one piece of work, and a batch of them on a worker
stamp    the versions of a worker's programs: results of different ones are not mixed
fleet    the workers: this process, a pool of processes, or those of a dask scheduler
driver   hands out the jobs in batches and survives failed workers
journal  results in a file that survives the driver
results  files of a study: tables, JSON, pictures, each written whole
engine   runs each job of a study once, even if workers and driver are killed
"""
