"""A motion as BVH, glTF or Blender script; may import `video`, `scene` and `body`."""
