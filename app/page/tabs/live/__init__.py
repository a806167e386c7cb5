"""The tab of live speech."""
