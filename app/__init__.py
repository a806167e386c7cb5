"""The page, the command line and the pipeline under both."""
