"""Run the jobs of a study in parallel, locally or on a dask scheduler.

job         a job, and a batch of jobs on a worker
workers     this process, a pool of processes, or the workers of a dask scheduler
dispatcher  sends jobs in batches and replaces failed workers
journal     a file of results, from which an interrupted study resumes
results     tables, JSON and plots, written atomically
engine      runs each job of a study once
"""
