"""Processes of our own beside this one: how to talk with one, how it ended, and many jobs done by
several or by a Dask cluster. May import `conventions`."""
