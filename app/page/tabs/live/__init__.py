"""The tab of live speech; may import what tabs may, and the tab of generated motion."""
