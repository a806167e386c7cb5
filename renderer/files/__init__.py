"""Export of a motion as BVH, glTF or Blender file; may import `video`, `scene` and `body`."""
