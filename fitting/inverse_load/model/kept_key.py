"""Names of arrays that are kept for one skin between runs."""

from typing import Any

from suas_jax.config import SkinSpec, continuous_inputs, structure
from suas_jax.runtime.content_key import content_key, source_digest


def kept_key(spec: SkinSpec, **more: Any) -> str:
    """Digest of a skin, of what else the arrays depend on, and of the source code."""
    return content_key(
        {
            "structure": structure(spec),
            "inputs": continuous_inputs(spec),
            "electrodes": repr(spec.electrodes),
            "source": source_digest(),
            **more,
        }
    )
