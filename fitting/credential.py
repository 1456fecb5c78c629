"""The token that whatever connects to a port of this program has to show.

Any local process reaches a port at 127.0.0.1, and any machine of the network one at another
address. So a port answers nobody before its token was shown: a new one for every run, or the
one of the environment variable `SUAS_TOKEN`, so that programs know it beforehand.
"""

import hmac
import os
import re
import secrets

VARIABLE = "SUAS_TOKEN"
LONGEST = 128
_ALLOWED = re.compile(rf"[A-Za-z0-9._~-]{{16,{LONGEST}}}")


def own_token() -> str:
    """The token of `SUAS_TOKEN`, else a new one of 192 random bits.

    Raises ValueError: the variable holds no token.
    """
    given = os.environ.get(VARIABLE)
    if given is None:
        return secrets.token_urlsafe(24)
    if _ALLOWED.fullmatch(given) is None:
        raise ValueError(
            f"{VARIABLE}: a token has 16 to {LONGEST} letters, digits or characters of ._~-"
        )
    return given


def is_token(shown: str | bytes, token: str) -> bool:
    """Whether this is the token; takes as long for any guess of one length."""
    shown = shown.encode(errors="replace") if isinstance(shown, str) else shown
    return hmac.compare_digest(shown, token.encode())
