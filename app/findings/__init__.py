"""What the numbers of a run say, in words; of app it imports nothing."""
