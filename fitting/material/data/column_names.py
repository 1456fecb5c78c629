"""The names that columns go by: in plain English words, and by the quantity that they mean."""

import re
from typing import NamedTuple

# Spelled without accents, longest first.
_WORDS = {
    # German
    "standardkraft": "standard_force",
    "pruefkraft": "test_force",
    "zugkraft": "tensile_force",
    "druckkraft": "compressive_force",
    "kraft": "force",
    "standardweg": "standard_travel",
    "traversenweg": "crosshead_travel",
    "kolbenweg": "actuator_travel",
    "verlaengerung": "extension",
    "laengenaenderung": "extension",
    "verschiebung": "displacement",
    "weg": "travel",
    "wahre_dehnung": "true_strain",
    "technische_dehnung": "nominal_strain",
    "nenndehnung": "nominal_strain",
    "stauchung": "compressive_strain",
    "dehnung": "strain",
    "wahre_spannung": "true_stress",
    "technische_spannung": "nominal_stress",
    "nennspannung": "nominal_stress",
    "zugspannung": "tensile_stress",
    "druckspannung": "compressive_stress",
    "schubspannung": "shear_stress",
    "spannung": "stress",
    "streckverhaeltnis": "stretch",
    "volumenverhaeltnis": "volume_ratio",
    "volumendehnung": "volumetric_strain",
    "volumenaenderung": "volume_change",
    "volumenstauchung": "volumetric_compression",
    "ueberdruck": "pressure",
    "innendruck": "pressure",
    "druck": "pressure",
    "pruefzeit": "test_time",
    "versuchszeit": "test_time",
    "zeit": "time",
    "zyklus": "cycle",
    "anfangsquerschnitt": "initial_area",
    "querschnittsflaeche": "area",
    "querschnitt": "area",
    "einspannlaenge": "grip_separation",
    "klemmlaenge": "clamping_length",
    "messlaenge": "gauge_length",
    "anfangslaenge": "initial_length",
    "probendicke": "specimen_thickness",
    "dicke": "thickness",
    "probenbreite": "specimen_width",
    "breite": "width",
    "probendurchmesser": "specimen_diameter",
    "durchmesser": "diameter",
    "hoehe": "height",
    # French
    "allongement": "elongation",
    "deplacement": "displacement",
    "deformation": "strain",
    "contrainte": "stress",
    "pression": "pressure",
    "rapport_de_volume": "volume_ratio",
    "epaisseur": "thickness",
    "largeur": "width",
    "longueur_initiale": "initial_length",
    "longueur": "length",
    "diametre": "diameter",
    "temps": "time",
    # Chinese and Japanese, whose words are not parted
    "试验力": "test_force",
    "試験力": "test_force",
    "载荷": "load",
    "负荷": "load",
    "荷重": "load",
    "真应力": "true_stress",
    "真応力": "true_stress",
    "工程应力": "nominal_stress",
    "名义应力": "nominal_stress",
    "公称応力": "nominal_stress",
    "应力": "stress",
    "応力": "stress",
    "真应变": "true_strain",
    "工程应变": "nominal_strain",
    "名义应变": "nominal_strain",
    "应变": "strain",
    "ひずみ": "strain",
    "位移": "displacement",
    "変位": "displacement",
    "变形": "extension",
    "伸长": "elongation",
    "伸び": "elongation",
    "ストローク": "stroke",
    "压力": "pressure",
    "圧力": "pressure",
    "时间": "time",
    "時間": "time",
    "标距": "gauge_length",
    "標点距離": "gauge_length",
    "宽度": "width",
    "厚度": "thickness",
    "厚さ": "thickness",
    "直径": "diameter",
    "面积": "area",
    "断面積": "area",
    "高度": "height",
    "力": "force",
    "幅": "width",
}
EASTERN_WORDS = tuple(word for word in _WORDS if len(word) > 1 and not word.isascii())
"""Words of tests by which a text's code page is known."""
_ACCENTS = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "é": "e", "è": "e", "ê": "e", "à": "a"}
)
_FOREIGN = re.compile(rf"(?<![a-z])(?:{'|'.join(_WORDS)})(?![a-z])")


def plain_words(text: str) -> str:
    """A name in English, lower case, without accents, words joined by underscores."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])(?!Pa)", "_", text.strip())
    text = text.casefold().translate(_ACCENTS)
    text = re.sub(r"[\s\-.:,;\"']+", "_", text).strip("_").replace("试样", "specimen_")
    return _FOREIGN.sub(lambda found: _WORDS[found.group()], text)


class Quantity(NamedTuple):
    """What a column can measure."""

    name: str  # how this project calls it
    dimension: str  # kind of unit; "area" is a length squared, "word" has none
    pattern: str  # regular expression of its names, blanks as underscores


QUANTITIES = tuple(
    Quantity(name, dimension, pattern)
    for name, dimension, pattern in (
        (
            "cauchy_difference",
            "stress",
            r"(?:cauchy|true)_stress_difference_(?:22_minus_11|2_minus_1)",
        ),
        (
            "cauchy_difference_reversed",
            "stress",
            r"(?:cauchy|true)_stress_difference_(?:11_minus_22|1_minus_2)",
        ),
        ("sigma_displacement", "length", r"(?:sigma|noise|uncertainty|std)_displacement"),
        ("sigma_force", "force", r"(?:sigma|noise|uncertainty|std)_force"),
        ("depth", "length", r"(?:loads_0_)?(?:indentation_)?depth|indentation"),
        (
            "sigma",
            "stress",
            r"(?:sigma|noise|uncertainty|std|stdev|standard_deviation|error)"
            r"(?:_(?:nominal|cauchy|engineering|true))?(?:_stress)?"
            r"(?:_(?:oil_)?pressure)?",
        ),
        ("nominal_shear", "stress", r"(?:nominal_|engineering_|cauchy_)?shear_stress"),
        ("cauchy", "stress", r"(?:cauchy|true|kirchhoff)_?stress"),
        ("second_pk", "stress", r"(?:second_piola_kirchhoff|pk2|2nd_pk|second_pk)(?:_stress)?"),
        (
            "nominal",
            "stress",
            r"(?:nominal|engineering|eng|first_piola_kirchhoff|pk1|1st_pk|first_pk|tensile"
            r"|compressive|compression|standard)_?stress|pk1|first_piola_kirchhoff",
        ),
        ("stress", "stress", r"(?:axial_)?stress"),
        (
            "pressure",
            "pressure",
            r"(?:inflation_|gauge_|differential_|oil_|hydrostatic_|confining_|chamber_)?pressure|p",
        ),
        (
            "force",
            "force",
            r"(?:axial_|static_|standard_|tensile_|tension_|compressive_|compression_|test_|load_cell_)*"
            r"(?:force|load)(?:_cell)?",
        ),
        ("time", "time", r"(?:test_|running_|total_|elapsed_)*time|t(?=_s$|_min$|$)"),
        ("cycle", "number", r"(?:total_|elapsed_)?cycles?(?:_(?:count|number|no))?"),
        (
            "volume_ratio",
            "number",
            r"(?:relative_)?volume_(?:ratio|stretch)|relative_volume|v/v_?[0o]|jacobian|j",
        ),
        (
            "volumetric_compression",
            "number",
            r"(?:volumetric|volume)_(?:compression|reduction|loss)"
            r"|compressive_(?:volumetric|volume)_strain",
        ),
        (
            "volumetric_strain",
            "number",
            r"(?:volumetric|volume|bulk)_strain|(?:relative_)?volume_change|dilatation|dv/v_?[0o]?",
        ),
        ("shear_angle", "angle", r"shear_angle"),
        ("shear", "number", r"shear_strain|amount_of_shear|shear|gamma|γ"),
        (
            "log_strain",
            "number",
            r"(?:log|true|hencky|logarithmic|natural|ln)_?strain|e(?:xx|yy|[12])_\[1\]_hencky",
        ),
        (
            "green_strain",
            "number",
            r"green(?:_lagrange)?_?strain|e(?:xx|yy|[12])_\[1\]_lagrange",
        ),
        (
            "strain",
            "number",
            r"(?:nominal_|engineering_|eng_|tensile_|compressive_|compression_|axial_|standard_"
            r"|corrected_|extensometer_|technical_)*strain|elongation_percent"
            r"|(?:section_\d+_|point_\d+_|mean_)?epsilon|e(?:xx|yy|[12])_\[1\]_(?:biot|engineering)",
        ),
        ("stretch", "number", r"(?:hoop_)?stretch(?:_ratio)?|extension_ratio|lambda|λ|lam"),
        (
            "displacement",
            "length",
            r"(?:crosshead_|cross_head_|loads_0_|axial_|standard_|tensile_|compressive_|actuator_"
            r"|corrected_|extensometer_|video_|machine_)*"
            r"(?:displacement|extension|elongation|stroke|travel|deflection|crosshead"
            r"|distance|position|extensometer)",
        ),
        (
            "grip_separation",
            "length",
            r"(?:initial_)?(?:grip|jaw|clamp)(?:_to_(?:grip|jaw|clamp))?_(?:separation|distance"
            r"|length)(?:_at_(?:the_)?start(?:_position)?)?|clamping_length",
        ),
        ("height", "length", r"(?:apex_|pole_|bulge_|dome_)?height|apex_displacement"),
        (
            "length",
            "length",
            r"(?:gauge_|gage_|initial_|original_|specimen_|parallel_)*length(?:_l?[0o])?|l[0o]",
        ),
        (
            "width",
            "length",
            r"(?:specimen_|plate_|sample_|initial_)*width(?:_[bw][0o]?)?|b0|w0",
        ),
        (
            "thickness",
            "length",
            r"(?:specimen_|plate_|sample_|wall_|initial_|membrane_)*thickness(?:_[abht][0o]?)?|h0|t0",
        ),
        ("diameter", "length", r"(?:specimen_|initial_)?diameter(?:_d[0o]?)?|d0"),
        ("rest_radius", "length", r"(?:initial|undeformed|reference|rest)_radius|r0"),
        ("radius", "length", r"(?:current_|balloon_|membrane_|diaphragm_)?radius"),
        (
            "area",
            "area",
            r"(?:specimen_|initial_|cross_section(?:al)?_)*area(?:_[as][0o]?)?|cross_section|a0|s0",
        ),
        ("thickness_ratio", "number", r"thickness_ratio|h_over_r"),
        ("weight", "number", r"weight"),
        ("use", "word", r"use|mask|valid|include"),
        ("specimen", "word", r"specimen|sample|specimen_id|sample_id"),
    )
)
