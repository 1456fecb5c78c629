"""Results as JSON text."""

import json
import math
from typing import Any


def json_text(tree: Any) -> str:
    """One line of JSON, in which numbers that are not finite become null, and -0.0 is 0.0."""
    return json.dumps(_finite(tree), allow_nan=False)


def _finite(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _finite(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_finite(value) for value in tree]
    if isinstance(tree, float):
        return tree + 0.0 if math.isfinite(tree) else None
    return tree
