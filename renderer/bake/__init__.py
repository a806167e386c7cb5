"""How the open body is made from MakeHuman's CC0 data: a developer's script, not needed to run.

``python -m renderer.bake --out DIR`` rewrites ``open_body.npz`` and ``skeleton.npz``.
"""
