"""How well one frame tells a load: the least standard deviations of its place and force."""

import numpy as np
from matplotlib.figure import Figure

from suas_jax import Loads, configure, load_jacobian, load_skin, skin_of

configure()
spec = load_skin("configs/skins/suas.toml")
angles = np.linspace(-65.0, 65.0, 66)
figure = Figure(figsize=(8, 3.5), layout="constrained")
left, right = figure.subplots(1, 2)
for force in (2.0, 8.0, 20.0):
    loads = Loads.line(np.radians(angles), np.full_like(angles, force))
    _, slopes = load_jacobian(skin_of(spec), loads)
    by = np.asarray(slopes)[:2, 0] / spec.electrodes.noise  # [angle / force, taxel, place]
    covariance = np.linalg.inv(np.einsum("itp,jtp->pij", by, by))  # Cramer and Rao
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    left.semilogy(angles, np.degrees(deviation[:, 0]), label=f"{force:g} N")
    right.plot(angles, deviation[:, 1], label=f"{force:g} N")
left.set(xlabel="angle of the load [deg]", ylabel="deviation of the angle [deg]")
right.set(xlabel="angle of the load [deg]", ylabel="deviation of the force [N]")
left.legend()
