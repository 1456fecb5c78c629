"""Artefacts of test machines: how often they are named, and how often mended fits cover.

`python benchmarks/material_artefacts.py [replicas]`: 200 random replicas of each artefact, with
1 % noise of each reading or 0.3 % of the largest; of each the share of plain fits that name the
artefact first, and the share of mended fits whose 95 % interval of the shear modulus holds the
truth.
"""

import pathlib
import sys
import tempfile

import jax
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))
from artefacts import CASES, MU

from fitting.material.experiments.datasets import load_dataset
from fitting.material.fit.fit import fit_material


def study(name: str, noise: str, replicas: int) -> tuple[float, float, float, float]:
    """Shares named and covered, mean modulus of mended fits and of plain ones [Pa]."""
    case = CASES[name]
    named = covered = 0
    mended, plain = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(replicas):
            file = case.write(pathlib.Path(folder) / "a.csv", seed, noise=noise)
            fit = fit_material([load_dataset("uniaxial", file)], "neo-hookean", starts=2)
            named += bool(fit.suspects) and fit.suspects[0].kind == case.kind
            plain.append(float(fit.constants[0]))
            data = load_dataset("uniaxial", file, **case.loading)
            fit = fit_material([data], "neo-hookean", starts=2, **case.fitting)
            value, low, high = fit.shear_modulus()
            covered += low <= MU <= high
            mended.append(value)
    return (named / replicas, covered / replicas, float(np.mean(mended)), float(np.mean(plain)))


def main() -> None:
    """Print the table."""
    jax.config.update("jax_enable_x64", True)
    replicas = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"{replicas} replicas, truth {MU / 1e6} MPa")
    print("artefact  noise     named  covered  mended [MPa]  plain [MPa]")
    for name in CASES:
        for noise in ("relative", "absolute"):
            named, covered, mended, plain = study(name, noise, replicas)
            print(
                f"{name:9} {noise:9} {100 * named:4.1f} %  {100 * covered:5.1f} %  "
                f"{mended / 1e6:.4f}        {plain / 1e6:.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
