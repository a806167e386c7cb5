"""A motion as BVH, glTF or Blender script; may import `video`, `stage` and `body`."""
