"""A procedural corpus of speech and co-speech motion in BEAT2's layout.

From text to motion, one module a step: ``texts`` (sentences), ``voice`` (flite), ``prosody``
(words, phrases, accents), ``speakers`` (styles), ``hand_shapes`` and ``gestures`` (the library),
``plan`` (gesture phases on the time line), ``arms``, ``body`` and ``face`` (motion), ``clip`` (one
clip put together), ``layout`` (files) and ``build`` (all clips, by several workers).
Nothing here needs torch, so that a worker process starts quickly.
"""
