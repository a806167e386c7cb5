"""Child processes, reports of how one ended, and parallel jobs; may import `conventions`."""
