"""The keys of a report in their order, and what each one means: SI units end the names."""

from suas_jax.config.errors import nearest

REPORT_KEYS = {
    "model": "what was solved: `shell` or `solid`",
    "dimension": "2 in plane strain, 3 with clamped ends",
    "status": "`converged`, or the name of the failure: the numbers then do not hold",
    "message": "the status in words, with remarks on what was found",
    "rtol_met": "whether `error_estimate` is at most the wanted `rtol`",
    "loads": "an object for each load, in the order of the file",
    "oil_pressure_Pa": "pressure of the oil above ambient",
    "ambient_pressure_Pa": "pressure of the water; only with `[environment]`",
    "absolute_oil_pressure_Pa": "sum of both; only with `[environment]`",
    "max_displacement_m": "largest displacement of the inner face",
    "max_displacement_angle_deg": "where, by current polar angle",
    "max_displacement_arc_m": "where, by arc length of the inner face; not on a circle",
    "max_displacement_axial_m": "where along the axis; in three dimensions",
    "min_gap_m": "smallest distance of the inner face from the wall",
    "min_gap_angle_deg": "where, by current polar angle",
    "min_gap_arc_m": "where, by arc length of the inner face; not on a circle",
    "min_gap_axial_m": "where along the axis; in three dimensions",
    "bulge_m": "largest outward displacement of the inner face",
    "bulge_angle_deg": "where, by current polar angle",
    "bulge_arc_m": "where, by arc length of the inner face; not on a circle",
    "bulge_axial_m": "where along the axis; in three dimensions",
    "wall_contact": "whether the inner face has reached the wall",
    "wall": "`null`, or the wall's `force_N` with its estimated error `force_error_N`, its "
    "`area_m2`, and from where to where it is touched, `angle_deg` and `axial_m`",
    "gap_tolerance_m": "deepest penetration of the wall, or indentation of its soft layer; "
    "`null` where the wall does not hold the membrane",
    "hoop_force_N_per_m": "mean force along the arc per width, tension positive; only where "
    "the skin carries stress at rest",
    "rest": "the same skin without its loads, where it carries stress then, see below",
    "strain_energy_J": "energy stored in the membrane",
    "stretch_min": "smallest hoop stretch of the inner face",
    "stretch_max": "largest hoop stretch of the inner face",
    "stable": "whether the equilibrium is stable on the whole skin with its oil; never so with "
    "the status `unstable` or `max_steps`",
    "stable_factor": "factor on the loads from which the path from rest is unstable; `null` "
    "where it is not. A state that is stable all the same has swayed",
    "material_stable": "whether every stretch lies in the law's window of stability",
    "volume_residual": "error of the oil's volume, relative to the film",
    "error_estimate": "sum of the two that follow; `null` where unknown",
    "discretisation_error": "relative error of pressure and displacement by the mesh",
    "model_error": "the same by the model: zero for the solid",
    "iterations": "Newton corrections from rest",
    "unknowns": "degrees of freedom, the oil's pressure included",
    "taxels": "an object for each taxel, by module and number; empty without electrodes",
    "timings_s": "`compile` and `solve` in seconds",
    "uncertainty": "where inputs state their errors: standard deviation of every quantity, by "
    "its path in this report; else `null`",
    "gradient": "with `--gradient`: derivative by every continuous input, in SI units and "
    "radians, by its path in the file",
    "gradient_error_estimate": "with `--gradient`: its relative error by mesh and model, in "
    "the norm of what a per cent of each input does; `null` where unknown",
    "friction_note": "of `suas sweep` where travels fall under friction: what is left out",
    "material_note": "what is to be known of the material, where its preset or file says so",
}
"""Keys of `suas solve --json`."""

REST_KEYS = {
    "stable": "whether the state at rest is; the whole solve has the status `unstable` if "
    "neither that nor the state under the loads is",
    "oil_pressure_Pa": "pressure of the oil above ambient",
    "hoop_force_N_per_m": "as above",
    "buckling_share": "of what buckles the skin, to first order: 1 where it does, negative "
    "where the stress stiffens every mode",
    "stiffness_change": "of what small loads of this pattern meet, relative to the same skin "
    "without stress; `null` without line loads and patches",
    "max_displacement_m": "largest displacement of the inner face",
    "min_gap_m": "smallest distance of the inner face from the wall",
    "displacement_m": "of the mid-surface under each load, along its direction; `null` for a "
    "pressure",
    "so": "sensor output of each taxel, in the order of `taxels`",
}
"""Keys of `rest`."""

LOAD_KEYS = {
    "kind": "`line`, `patch`, `pressure` or `body`",
    "angle_deg": "where it acts; of a path or spline the direction of the normal",
    "arc_m": "where, by arc length of the inner face from its middle; not on a circle",
    "arc_position_m": "the same along the outer face",
    "axial_m": "where along the axis; in three dimensions",
    "force_N": "total force, as scaled to reach a wanted oil pressure",
    "depth_m": "travel of a body beyond first touch, given or found",
    "tangential_force_N": "of a body on the skin, along growing angles; its `force_N` is that "
    "along the approach",
    "tangential_force_axial_N": "the same along the axis; in three dimensions",
    "drag_m": "travel of a body along growing angles, given or found; of one that is dragged",
    "drag_axial_m": "the same along the axis; in three dimensions",
    "moment_Nm": "of that force about a round body's centre, or a flat one's reference point, "
    "counter-clockwise",
    "contact_area_m2": "of the undeformed outer face that a body touches",
    "contact_half_width_m": "half the extent of that along the arc",
    "contact_from_m": "where it begins, by arc length of the outer face from the reference "
    "point",
    "contact_to_m": "where it ends",
    "max_contact_pressure_Pa": "largest pressure of a body on the skin",
    "contact_resolved": "whether enough points touch to state width and largest pressure; "
    "force and travel have the errors stated in any case",
    "zones": "how many parts of the outer face a body touches",
    "displacement_m": "of the mid-surface under the load, along its direction",
    "inner_displacement_m": "of the inner face under the load, along its direction",
    "pressure_Pa": "of a uniform pressure, in place of all the others",
}
"""Keys of an entry of `loads`."""

TAXEL_KEYS = {
    "module": "number of the module, from 0",
    "taxel": "number in the module, from 1",
    "angle_deg": "of its centre, from the symmetry axis",
    "arc_m": "of its centre, by arc length of the inner face; not on a circle",
    "axial_m": "of its centre, from mid-width",
    "gap_m": "distance of wall and inner face on the ray through its centre",
    "capacitance_F": "`null` where the membrane touches a taxel without layers",
    "so": "sensor output, capacitance over the capacitance of a count; not rounded",
}
"""Keys of an entry of `taxels`."""


def require_reported(path: str, loads: int) -> None:
    """Refuse a path that no report has, before a scene of so many loads is solved for it.

    Raises ValueError: names what there is, such as ``loads.0.displacement_m``.
    """
    table, *rest = path.split(".")
    known = {"loads": LOAD_KEYS, "taxels": TAXEL_KEYS}.get(table)
    if known is None:
        allowed = [key for key in REPORT_KEYS if key not in ("loads", "taxels")]
        if table in allowed:
            return
        allowed += ["loads.0.displacement_m", "taxels.0.so"]
    else:
        index = int(rest[0]) if rest and rest[0].isdecimal() else -1
        exists = index >= 0 and (table == "taxels" or index < loads)
        if exists and len(rest) == 2 and rest[1] in known:
            return
        allowed = [f"{table}.{i}.{key}" for i in range(max(loads, 1)) for key in known]
    near = nearest(path, allowed)
    hint = f'; did you mean "{near}"?' if near else f"; use one of {', '.join(allowed)}"
    raise ValueError(f'"{path}" is not a quantity of the report{hint}')
