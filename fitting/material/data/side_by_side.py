"""Specimens that stand side by side in one table: which columns belong to which.

A column belongs to a specimen by the label in its name ("Specimen 2 Force"), by a number at the
end of its name where all numbered sets are alike ("Stress 2 (MPa)"), or by its place in a
sequence of names that is repeated; columns before or without these are common to all specimens.
"""

import re

from fitting.material.data.columns import split_specimen


def side_by_side(
    names: list[str], groups: list[str], *, fixed: bool, plane: bool
) -> list[tuple[str, list[int]]]:
    """Columns of each specimen, by its label; one group where there is only one.

    Args:
        names: of the columns, with their units.
        groups: specimen of each column, from a row above the names; "" where there is none.
        fixed: the user says what columns measure, of a single specimen.
        plane: numbers in names are directions in the plane, not specimens.
    """
    everything = [i for i, name in enumerate(names) if name]
    whole = [("", list(range(len(names))))]
    if fixed or len(everything) < 2:
        return whole
    labels = [split_specimen(name)[1] for name in names]
    if not any(labels) and not plane:
        labels = _numbered(names)
    if len({label for label in labels if label}) > 1:
        shared = [i for i in everything if not labels[i]]
        order = dict.fromkeys(label for label in labels if label)
        return [
            (label, shared + [i for i in everything if labels[i] == label]) for label in order
        ]
    # Repeated sequences: a name that returns begins the next specimen. What stands before
    # the first such name is common to all.
    first = next((names[i] for i in everything if names.count(names[i]) > 1), None)
    starts = [k for k, i in enumerate(everything) if names[i] == first]
    if len(starts) < 2:
        return whole
    shared = everything[: starts[0]]
    blocks = [
        everything[a:b] for a, b in zip(starts, [*starts[1:], len(everything)], strict=True)
    ]
    alike = len({tuple(names[i] for i in block) for block in blocks}) == 1
    if not alike or len(shared) + len(blocks[0]) < 2:
        return whole
    stated = [groups[block[0]] for block in blocks]
    if len(set(stated)) < len(stated):
        stated = [str(k + 1) for k in range(len(blocks))]
    return [(label, shared + block) for label, block in zip(stated, blocks, strict=True)]


def _numbered(names: list[str]) -> list[str]:
    """Numbers at the ends of names, such as 2 in "Stress 2 (MPa)", where all sets are alike."""
    found = [re.fullmatch(r"(.*?[^\W\d])[ _]?(\d{1,2})(\s*[\[(].*)?", name) for name in names]
    sets: dict[str, list[str]] = {}
    for match in found:
        if match is not None:
            sets.setdefault(match.group(2), []).append(match.group(1) + (match.group(3) or ""))
    alike = len(sets) > 1 and len({tuple(own) for own in sets.values()}) == 1
    if not alike or len(next(iter(sets.values()))) < 2:
        return [""] * len(names)
    return [match.group(2) if match is not None else "" for match in found]
