"""Start of a pad's estimator whose table is kept: until the first frame, and in what memory.

``python -m benchmarks.pad_start``: one contact, which needs no JAX, beside three, whose trials
are solved.
"""

import subprocess
import sys
from pathlib import Path

from rich.console import Console

_SKIN = Path(__file__).parents[1] / "configs" / "skins" / "suas-pad.toml"
_START = """
import resource, sys
from fitting import LoadEstimator
from suas_jax import load_skin
from suas_jax.runtime.start import configure_when_computing

configure_when_computing()
estimator = LoadEstimator(load_skin(sys.argv[1]), live=True, most_contacts=int(sys.argv[2]))
estimator.warm_up()
estimator.estimate(estimator.model_rest[None])
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3, "jax" in sys.modules)
"""


def main() -> None:
    """Print processor time and memory of both, the second time that each is started."""
    console = Console()
    for contacts in ("1", "3"):
        command = [sys.executable, "-c", _START, str(_SKIN), contacts]
        for _ in range(2):  # the first may make the table
            done = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds, memory, started = done.stdout.split()
        console.print(
            f"up to {contacts} contacts: {float(seconds):.1f} CPU s, {float(memory):.0f} MB, "
            f"JAX {'started' if started == 'True' else 'not started'}"
        )


if __name__ == "__main__":
    main()
