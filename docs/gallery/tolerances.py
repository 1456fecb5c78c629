"""What decides the force: one standard deviation of every tolerance of the skin file."""

from matplotlib.figure import Figure

from fitting import data_sheet
from suas_jax import configure, load_skin

configure()
report = data_sheet(load_skin("configs/skins/suas.toml")).report()
tolerances = report["tolerances"][::-1]  # the largest at the top

figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
names = [tolerance["name"] for tolerance in tolerances]
axes.barh(names, [100 * tolerance["force_relative"] for tolerance in tolerances])
axes.set(xlabel="change of the estimated force [%]")
print(f"range {report['figures']['range_N']['value']:.1f} N")
