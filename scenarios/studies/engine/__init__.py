"""Run the jobs of a study in parallel, locally or on a dask scheduler."""
