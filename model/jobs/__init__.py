"""Many independent pieces of work, each done once: by processes of this machine, or by a Dask
cluster. May import `model.storage`."""
