"""Names of columns in plain English words, whatever language and spelling a file has."""

import re

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
}
_ACCENTS = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "é": "e", "è": "e", "ê": "e", "à": "a"}
)
_FOREIGN = re.compile(rf"(?<![a-z])(?:{'|'.join(_WORDS)})(?![a-z])")


def plain_words(text: str) -> str:
    """A name in English, lower case, without accents, words joined by underscores."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])(?!Pa)", "_", text.strip())
    text = text.casefold().translate(_ACCENTS)
    text = re.sub(r"[\s\-.:,;\"']+", "_", text).strip("_")
    return _FOREIGN.sub(lambda found: _WORDS[found.group()], text)
