"""A procedural corpus of speech and co-speech motion in BEAT2's layout.

From text to motion, one module a step: ``topics``, ``grammar`` and ``texts`` (sentences), ``voice``
(flite), ``prosody`` (words, phrases, accents), ``speaker`` and ``speakers`` (styles),
``hand_shapes`` and ``gestures`` (the library), ``choice``, ``places``, ``manner`` and ``plan``
(gesture phases on the time line), ``arms``, ``body``, ``legs`` and ``face`` (motion), ``clip`` (one
clip put together), ``layout`` (files) and ``build`` (all clips, by several workers).
Nothing of this needs torch, so that a worker process starts quickly.
"""
