"""Who is asking, and the files of each visitor for that visitor alone; may import parts."""
