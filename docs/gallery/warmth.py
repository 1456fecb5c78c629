"""A dent in cold and warm water: under 5 N, and the oil's pressure before they come."""

import numpy as np
from matplotlib.figure import Figure

from suas_jax import configure, scene_from_dict, solve, with_inputs

configure()
parts = {"material": "EPDM", "oil": "silicone-oil", "wall": "PLA"}
described = {part: {"expansion": substance} for part, substance in parts.items()}
load = {"kind": "line", "angle": "0 deg", "force": "5 N"}
warm = {"temperature": "20 degC"}
skin = {"skin": "configs/skins/suas.toml", "environment": warm, "load": [load]}
scene = scene_from_dict({**described, **skin})
degrees = np.linspace(5.0, 24.0, 9)
inputs = [{"environment.temperature": 273.15 + degree} for degree in degrees]
reports = [solve(with_inputs(scene, own)).report for own in inputs]

figure = Figure(figsize=(8, 3.5), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(degrees, [1e3 * report["loads"][0]["displacement_m"] for report in reports], ".-")
left.set(xlabel="temperature [°C]", ylabel="dent under 5 N [mm]")
right.plot(degrees, [report["rest"]["oil_pressure_Pa"] for report in reports], ".-")
right.set(xlabel="temperature [°C]", ylabel="oil pressure at rest [Pa]")
