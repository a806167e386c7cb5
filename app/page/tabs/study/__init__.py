"""The tab of user studies: made and evaluated."""
