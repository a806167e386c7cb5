"""The tab of user studies: made and evaluated; may import what tabs may, and the form of speech."""
