"""The tab of generated motion: form, run, opening example, takes; may import what tabs may."""
