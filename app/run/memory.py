"""Memory that a run has freed goes back to the system at once."""

from __future__ import annotations

import ctypes
import sys

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 1 << 20


def return_large_blocks() -> None:
    """Make glibc map each block of a megabyte and more by itself.

    By default it raises that limit to 32 MB as a program goes on, and what a long clip needs for a
    moment then stays in the heap: the peak of a ten-minute clip grows by a tenth. Elsewhere than on
    glibc this does nothing.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
    except (OSError, AttributeError):  # another C library
        return
