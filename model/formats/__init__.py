"""Motion files of other tools, with all that was assumed of them told; may import motion."""
