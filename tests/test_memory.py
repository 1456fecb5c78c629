"""Memory that was freed and is given back to the system."""

import platform
from pathlib import Path

import pytest

from suas_jax.runtime.compiled import give_back_freed_memory

PAGE = 4096


def resident() -> int:
    """Memory of this process [pages]."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="what GNU's C library does")
def test_what_was_freed_is_given_back() -> None:
    pages = 20_000
    blocks = [bytes(PAGE) for _ in range(pages)]
    last = blocks.pop()  # at the end of the heap, which so can't shrink by itself
    del blocks
    before = resident()
    give_back_freed_memory()
    assert before - resident() > pages / 2
    assert len(last) == PAGE
