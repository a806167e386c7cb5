"""Noise of its own for every clip of a set."""

import hashlib


def clip_seed(seed: int, name: str) -> int:
    """The seed of one clip, 0 to 2**31 - 1, from that of the set and the clip's name.

    Systems that get the same one are compared on the same noise; two clips that share noise move
    much alike whatever is said in them.
    """
    digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
    return int.from_bytes(digest[:4], "little") >> 1
