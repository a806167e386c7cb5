"""The tab of own motion: files of anyone, one by one or as a set; may import what tabs may."""
