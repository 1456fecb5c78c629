"""The cards of each program, in its own convention.

A term of Ogden's law is 2 mu/alpha^2 (sum l^alpha - 3) with mu = mu_p alpha_p / 2 in Abaqus,
CalculiX and FElupe, mu/alpha (sum l^alpha - 3) with mu = mu_p in ANSYS, COMSOL and LS-DYNA, and
c/m^2 (sum l^m - 3) with c = mu_p alpha_p in FEBio. D1 of Abaqus and d of ANSYS are 2/K.
Constants are the long-term ones, but for those of ANSYS beside TB,PRONY.
"""

from collections.abc import Iterable, Sequence

from fitting.material.cards.settings import BULK, CardError, Material, degree_of
from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec
from suas_jax.config.laws.neo_hookean import NeoHookeanSpec

_POLYNOMIALS = "neo-hookean, mooney-rivlin, yeoh, polynomial"
_OFFERED = f"ogden, arruda-boyce, {_POLYNOMIALS}"


def _numbers(values: Iterable[float], between: str = ", ") -> str:
    return between.join(f"{value:.12g}" for value in values)


def _runs(values: Sequence[float], most: int) -> list[Sequence[float]]:
    return [values[i : i + most] for i in range(0, len(values), most)]


def abaqus(material: Material) -> str:
    """The card for Abaqus; D1 is zero without a bulk modulus: hybrid elements."""
    moduli = ", MODULI=LONG TERM" if material.prony else ""
    text = _keywords(material, 6, material.compressibility, moduli)
    if material.prony:
        text += "*VISCOELASTIC, TIME=PRONY\n"
        text += "".join(f"{g:.12g}, 0.0, {tau:.12g}\n" for g, tau in material.prony)
    return text + (
        f"*MULLINS EFFECT\n{_numbers(material.mullins)}\n" if material.mullins else ""
    )


def calculix(material: Material) -> str:
    """The card for CalculiX; it chooses a D of its own for zero, so that it gets one."""
    return _keywords(material, 4, 2.0 / material.demanded_bulk)


def _keywords(material: Material, most: int, d: float, moduli: str = "") -> str:
    """The elastic part in the format that Abaqus and CalculiX share."""
    unit, law = material.unit, material.law
    text = f"** {law.law}, {unit}, shear modulus {material.shear_modulus:.6g} {unit}\n"
    text += f"*MATERIAL, NAME={material.name.upper()}\n"
    if material.density is not None:
        text += f"*DENSITY\n{material.density:.12g}\n"
    if (terms := material.at_most(most)) is not None:
        kind = f"OGDEN, N={len(terms)}"
        values = [x for mu, alpha in terms for x in (0.5 * mu * alpha, alpha)]
        values += [d] + [0.0] * (len(terms) - 1)
    elif isinstance(law, ArrudaBoyceSpec):
        kind, values = "ARRUDA-BOYCE", [law.mu, law.lambda_m, d]
    else:
        degree, values = material.polynomial(_OFFERED)
        kind, values = f"POLYNOMIAL, N={degree}", [*values, d] + [0.0] * (degree - 1)
    rows = "\n".join(map(_numbers, _runs(values, 8)))
    return f"{text}*HYPERELASTIC, {kind}{moduli}\n{rows}\n"


def ansys(material: Material) -> str:
    """The card for ANSYS; without a bulk modulus d is zero: incompressible."""
    unit, d = material.unit, material.compressibility
    text = (
        f"! {material.name}: {material.law.law}, {unit}, "
        f"{'d = 2/K' if d else 'incompressible (d = 0)'}, shear modulus "
        f"{material.shear_modulus:.6g} {unit}\n"
    )
    if material.density is not None:
        text += f"MP,DENS,1,{material.density:.12g}\n"
    at_once = material.instantaneous()
    if (terms := at_once.ogden) is not None:
        values = [x for term in terms for x in term] + [d] + [0.0] * (len(terms) - 1)
        text += _table(f"TB,HYPER,1,1,{len(terms)},OGDEN", values)
    elif isinstance(material.law, NeoHookeanSpec):
        text += _table("TB,HYPER,1,1,1,NEO", [at_once.shear_modulus, d])
    else:
        degree, values = at_once.polynomial(f"ogden, {_POLYNOMIALS}")
        text += _table(f"TB,HYPER,1,1,{degree},POLY", [*values, d] + [0.0] * (degree - 1))
    if material.prony:
        text += "! constants of TB,HYPER are the instantaneous ones\n"
        values = [x for pair in material.prony for x in pair]
        text += _table(f"TB,PRONY,1,1,{len(material.prony)},SHEAR", values)
    return text + (_table("TB,CDM,1,1,3,PSE2", material.mullins) if material.mullins else "")


def _table(head: str, values: list[float]) -> str:
    rows = (
        f"TBDATA,{6 * i + 1},{_numbers(run, ',')}" for i, run in enumerate(_runs(values, 6))
    )
    return "\n".join([head, *rows]) + "\n"


def comsol(material: Material) -> str:
    """Parameters to load from a file; the law is long-term, shares are of the instantaneous."""
    law, unit = material.law, material.unit
    volume = "incompressible" if material.bulk is None else "nearly incompressible"
    lines = [f"% {material.name}, {law.law}: Parameters > Load from File; {volume} material"]
    if (terms := material.ogden) is not None:
        for i, (mu, alpha) in enumerate(terms, 1):
            lines += [f"mu_{i} {mu:.12g}[{unit}]", f"alpha_{i} {alpha:.12g}"]
    elif (coefficients := law.coefficients()) is not None:
        lines += [f"C{i}{j} {value:.12g}[{unit}]" for (i, j), value in coefficients.items()]
    else:
        for key, declared in law.declared().items():
            shown = f"[{unit}]" if declared.unit == "Pa" else ""
            lines.append(f"{key} {getattr(law, key):.12g}{shown}")
    if material.bulk is not None:
        lines.append(f"kappa {material.bulk:.12g}[{unit}]")
    for i, (g, tau) in enumerate(material.prony, 1):
        lines += [f"g_{i} {g:.12g}", f"tau_{i} {tau:.12g}[s]"]
    if material.mullins:
        r, m, beta = (f"{value:.12g}" for value in material.mullins)
        lines += [f"mullins_r {r}", f"mullins_m {m}[{unit}]", f"mullins_beta {beta}"]
    return "\n".join(lines) + "\n"


def febio(material: Material) -> str:
    """The card for FEBio, whose bulk modulus k is `BULK` shear moduli if none is known.

    Shares of the relaxation are over the long-term modulus, whose own share is one.
    """
    most = 6
    if (terms := material.at_most(most)) is not None:
        kind = "Ogden"
        entries = [(f"c{i}", mu * alpha) for i, (mu, alpha) in enumerate(terms, 1)]
        entries += [(f"m{i}", alpha) for i, (_, alpha) in enumerate(terms, 1)]
    else:
        coefficients = {k: v for k, v in (material.law.coefficients() or {}).items() if v}
        if not coefficients or degree_of(coefficients) != 1:
            raise material.missing("ogden, neo-hookean, mooney-rivlin with C1 and C2 only")
        kind, places = "Mooney-Rivlin", (("c1", (1, 0)), ("c2", (0, 1)))
        entries = [(name, coefficients.get(place, 0.0)) for name, place in places]
    lines = [f"<{k}>{x:.12g}</{k}>" for k, x in [*entries, ("k", material.demanded_bulk)]]
    density = []
    if material.density is not None:
        density = [f"<density>{material.density:.12g}</density>"]
    lines = density + lines
    bulk = f"{BULK:g} shear moduli, nearly incompressible"
    if material.bulk is not None:
        bulk = f"{material.bulk:.6g} {material.unit}"
    outer = kind
    if material.prony:
        if len(material.prony) > most:
            raise material.missing(f"at most {most} Prony terms")
        share, outer = material.long_term_share, "uncoupled viscoelastic"
        series = ["<g0>1</g0>"]
        for i, (g, tau) in enumerate(material.prony, 1):
            series += [f"<g{i}>{g / share:.12g}</g{i}>", f"<t{i}>{tau:.12g}</t{i}>"]
        # Inertia and weight take the outer density, or in old versions the inner one.
        lines = [*density, *series, f'<elastic type="{kind}">', *_inside(lines), "</elastic>"]
    note = f"<!-- {material.law.law}, {material.unit}; k is {bulk} -->"
    opening = f'<material id="1" name="{material.name}" type="{outer}">'
    return "\n".join([note, opening, *_inside(lines), "</material>"]) + "\n"


def _inside(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


_PLACES = ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (3, 0))


def lsdyna(material: Material) -> str:
    """The card for LS-DYNA; nearly incompressible, by Poisson's ratio.

    *MAT_OGDEN_RUBBER (77_O) or *MAT_HYPERELASTIC_RUBBER (77_H). The relaxation is a stress
    beside the long-term law, of moduli G_i = g_i G(0) with decay constants 1/tau_i: that of the
    fit at small strain only.
    """
    most, most_prony = 8, 12
    unit, g, k = material.unit, material.shear_modulus, material.demanded_bulk
    poisson = (3.0 * k - 2.0 * g) / (2.0 * (3.0 * k + g))
    if material.density is None:
        raise CardError("--export lsdyna: the program needs a density: give --density")
    head = f"$ {material.law.law}, {unit}, shear modulus {g:.6g} {unit}, "
    head += f"bulk modulus {k:.6g} {unit}\n"
    # Ten columns hold nine decimals without the zero, which a soft rubber's bulk modulus needs.
    first = f"{1:>10d}{material.density:>10.4g}{f'{poisson:.9f}'[1:]}{0:>10d}"
    if (terms := material.at_most(most)) is not None:
        filled = [*terms, *[(0.0, 0.0)] * (most - len(terms))]
        keyword, rows = "MAT_OGDEN_RUBBER", [*map(_exact, zip(*filled, strict=True))]
    else:
        offered = "ogden, and polynomials with C10, C01, C11, C20, C02, C30"
        coefficients = material.coefficients(offered)
        if any(value and place not in _PLACES for place, value in coefficients.items()):
            raise material.missing(offered)
        values = [coefficients.get(place, 0.0) for place in _PLACES]
        keyword, rows = "MAT_HYPERELASTIC_RUBBER", [_exact(values)]
    if len(material.prony) > most_prony:
        raise material.missing(f"at most {most_prony} Prony terms")
    at_once = g / material.long_term_share
    rows += [_exact([share * at_once, 1.0 / tau]) for share, tau in material.prony]
    return head + "\n".join([f"*{keyword}_TITLE", material.name, first, *rows]) + "\n"


def _exact(values: Iterable[float]) -> str:
    """Numbers in free format, separated by commas: ten columns would cut them."""
    return ",".join(f"{value:.9g}" for value in values)


_MODELS = "mat.models.hyperelastic"
_POLYNOMIAL = '''from tensortrax.math import trace
from tensortrax.math.linalg import det


def energy(C, **unused):
    """Strain energy, a polynomial of I1 - 3 and I2 - 3."""
    J3 = det(C) ** (-1 / 3)
    I1 = J3 * trace(C)
    I2 = (I1**2 - J3**2 * trace(C @ C)) / 2
    return {terms}


'''


def felupe(material: Material) -> str:
    """The card for FElupe, a module whose `umat` is the material: the law and its softening.

    The law is isochoric: a solid adds the bulk modulus,
    `SolidBodyNearlyIncompressible(umat, field, bulk)`.
    """
    law, imports, constants = material.law, "", list[str]()
    if (terms := material.ogden) is not None:
        mu, alpha = (
            _numbers(x) for x in zip(*[(0.5 * m * a, a) for m, a in terms], strict=True)
        )
        energy, constants = f"{_MODELS}.ogden", [f"mu=[{mu}]", f"alpha=[{alpha}]"]
    elif isinstance(law, ArrudaBoyceSpec):
        energy = f"{_MODELS}.arruda_boyce"
        constants = [f"C1={law.mu:.12g}", f"limit={law.lambda_m:.12g}"]
    else:
        parts = [
            " * ".join([f"{value:.12g}", *_power("I1", i), *_power("I2", j)])
            for (i, j), value in material.coefficients(_OFFERED).items()
        ]
        energy, imports = "energy", _POLYNOMIAL.replace("{terms}", " + ".join(parts))
    modulus = f"shear modulus {material.shear_modulus:.6g} {material.unit}"
    text = f'"""{material.name}: {law.law}, {modulus}."""\n\n'
    text += "import felupe.constitution.tensortrax as mat\n" + imports + "\n"
    if material.density is not None:
        text += f"density = {material.density:.12g}\n"
    if material.bulk is not None:
        text += f"bulk = {material.bulk:.12g}\n"
    arguments = [energy, *constants]
    if material.mullins:
        if constants:
            call = f"{energy}(C, {', '.join(constants)})"
            text += f"\n\ndef energy(C, **unused):\n    return {call}\n\n\n"
        pairs = zip(("r", "m", "beta"), material.mullins, strict=True)
        constants = [f"{name}={value:.12g}" for name, value in pairs]
        arguments = [f"{_MODELS}.ogden_roxburgh", "material=energy", *constants, "nstatevars=1"]
    return text + f"umat = mat.Hyperelastic({', '.join(arguments)})\n"


def _power(name: str, exponent: int) -> list[str]:
    return [f"({name} - 3) ** {exponent}"] if exponent else []
