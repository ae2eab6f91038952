"""Keeping freed memory at hand.

The C library hands large blocks back to the system and fetches them again, page by page: at every step, which takes
about a twentieth of a training step of size n on a CPU, and at every picture of a camera, whose resident memory goes up
and down by the 6 MiB of each that is on its way.
"""

import contextlib
import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h
LARGEST_BLOCK = 2**30
"""Bytes; a picture, and a tensor of a training step on a CPU, is smaller."""


def keep_freed_memory() -> bool:
    """Let this process reuse what it has freed; it then stays as large as it has ever been (but see below).

    Returns:
        Whether the C library can (glibc); elsewhere nothing changes.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another system's library; TypeError is how Windows says so
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGEST_BLOCK)) and bool(mallopt(M_TRIM_THRESHOLD, 2**31 - 1))


def give_back_freed_memory() -> None:
    """Hand all pages that nothing lies on back to the system, where the C library can.

    Blocks of ever other sizes, as those of batches with ever other numbers of boats, leave more and more of them unused
    between each other.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
