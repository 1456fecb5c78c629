"""Guess what an unintelligible stream is, and what to try."""

from suas_jax.acquisition.frames.registry import FORMATS

_PRINTABLE = frozenset(b"\t\r\n" + bytes(range(32, 127)))


def not_understood(name: str, wanted: str, recent: bytes) -> str:
    """A sentence for bytes that come but make no frame of the wanted format."""
    start = f'{name}: bytes come, but no frame of the format "{wanted}" among them'
    for other, known in FORMATS.items():
        if other == wanted:
            continue
        attempt = known.decoder()
        if (
            known.looks_like(recent)
            if known.looks_like is not None
            else attempt.feed(recent, 0.0) or attempt.finish()
        ):
            return f"{start}; they look like {other}: try --format {other}"
    printable = sum(byte in _PRINTABLE for byte in recent) / max(len(recent), 1)
    if printable > 0.95:
        line = max(recent.decode("ascii", "replace").splitlines()[1:-1], key=len, default="")
        shown = f', such as "{line[:60]}"' if line else ""
        return (
            f"{start}; they are text{shown}; a line must read "
            "seq,t_device_s,module,so_1,...,so_n with whole counts from 0 to 65535"
        )
    return (
        f"{start}; {100 * (1 - printable):.0f} % of them are no text: a wrong --baud makes "
        f"this, or another --format ({', '.join(f for f in FORMATS if f != wanted)})"
    )
