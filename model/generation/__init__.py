"""What a system is, and how its windows become motion of any length; may import training."""
