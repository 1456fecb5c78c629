"""Memory that was freed, given back to the system."""

import contextlib
import ctypes


def give_back_freed_memory() -> None:
    """Let the C library give back what was freed, which it keeps until it is told.

    Loading or compiling a program takes for an instant what the program itself takes, hundreds
    of megabytes for a pad. Nothing happens where the C library is not GNU's.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
