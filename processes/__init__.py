"""Child processes: communication, reports of how one ended, and parallel jobs on this machine or a
Dask cluster. It may import `conventions`."""
