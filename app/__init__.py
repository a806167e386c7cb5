"""The page, the command line, user studies, and the runs under all of them."""
