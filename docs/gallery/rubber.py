"""A law from a test machine: Treloar's three tests and Ogden's law through all of them."""

from matplotlib.figure import Figure

from fitting import fit_material, load_dataset
from suas_jax import configure

configure()
modes = ("uniaxial", "equibiaxial", "pure_shear")
tests = [load_dataset(mode, f"configs/data/treloar1944_{mode}.csv") for mode in modes]
fit = fit_material(tests, "ogden", terms=3)

figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
for mode, test in zip(modes, tests, strict=True):
    (points,) = axes.plot(test.abscissa, 1e-6 * test.value, "o", label=mode.replace("_", " "))
    band = fit.predict(mode, test.abscissa)
    axes.plot(band.stretch, 1e-6 * band.law, color=points.get_color())
axes.set(xlabel="stretch", ylabel="nominal stress [MPa]")
axes.legend()
