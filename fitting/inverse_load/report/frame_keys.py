"""The keys of a frame's estimate as JSON, and what each one means: SI units end the names."""

FRAME_KEYS = {
    "t_s": "time by the device's clock, or by the host's where the device has none",
    "contact": "whether anything touches the skin; `null` where the readings cannot tell",
    "loads": "an object for each contact, by angle",
    "oil_pressure_Pa": "pressure of the oil in the state that explains the frame",
    "wall_contact": "whether the membrane touches the wall in that state",
    "chi2_per_dof": "weighted squares of the residuals per degree of freedom: about 1 where "
    "the model holds",
    "latency_s": "of a log the computing time of the frame, live the time from its last byte "
    "to its estimate",
    "status": "a status of the next table",
    "seq": "number of the frame",
    "left_out": "taxels that were missing, saturated, stuck or outliers, by position in the "
    "layout",
    "force_at_least_N": "at the wall: the force that acts at least (95 %)",
    "drift_counts": "with `--baseline`: drift that was taken off the readings at rest, `mean` "
    "and `largest` over the taxels",
    "alternatives": "other loads that explain the frame almost as well, where there are any: "
    "another place of one contact, or two contacts in place of a wide one",
    "field": "a load field that explains the frame as well as contacts do, or better",
    "tap": "with the first frame at rest after a tap, or live with one soon after it, as the "
    "budget allows: `t_s` before it, `duration_s` that the skin moved, the place, as of "
    "contacts, with standard deviations such as `axial_deviation_m`, `impulse_Ns` and its own "
    "`impulse_deviation_Ns`",
    "filtered": "with `--filter`: the loads followed over time",
    "dropped": "live: frames that were left out so far",
    "posterior": "with `--posterior`: modes of the frame, each with its loads and probability",
}
"""Keys of a line of `suas invert --json`."""

CONTACT_KEYS = {
    "angle_deg": "place, from the symmetry axis",
    "force_N": "total force, inwards; negative where the skin is pulled",
    "arc_m": "arc length of the inner face from its middle; not on a circle",
    "axial_m": "on a pad: place along the axis, from the middle",
    "diameter_m": "on a pad with `--diameter free`: of the contact",
    "extent_arc_m": "on a pad: diameter along the arc of the even ellipse with the contact's "
    "second moments (a strip of length L has 1.15 L); `null` where the taxels cannot tell",
    "extent_arc_deviation_m": "its standard deviation",
    "extent_axial_m": "the same along the axis",
    "extent_axial_deviation_m": "its standard deviation",
    "tangential_force_N": "force on the skin towards growing angles, on a section where "
    "readings make a radial one unlikely; on a pad `null` where the taxels cannot tell",
    "tangential_force_deviation_N": "its standard deviation",
    "tangential_force_axial_N": "the same along the axis",
    "tangential_force_axial_deviation_N": "its standard deviation",
    "spread_m": "arc that a wide contact presses; `spread_deviation_m` is its deviation",
    "direction_deg": "with `--direction`: turn from the inward radial, counter-clockwise",
    "tilt_deg": "on a pad with `--direction`: turn towards +axial",
    "covariance": "of angle, axial place, force, diameter, direction and tilt, as far as they "
    "are estimated, in this order, in rad, m and N; `null` where no error can be stated",
    "covariance_of": "the order, where the place is estimated by arc",
    "covariance_noise": "the part of the covariance that comes from the readings' noise",
    "systematic_covariance": "the part that comes from the skin file's tolerances, which all "
    "frames share: no average over frames makes it smaller",
    "arc_position_m": "place on the undeformed outer face, from the symmetry axis",
}
"""Keys of an entry of `loads`."""

FIELD_KEYS = {
    "force_N": "total along the inward normals, of the likeliest forces",
    "force_interval_N": "holds it in 95 of 100 cases, as the other intervals do: noise, "
    "tolerances, and a pressure even all over the skin, which oil hides",
    "angle_deg": "centre of the forces, with `angle_interval_deg`",
    "arc_m": "the same as arc length of the inner face, with `arc_interval_m`; not on a circle",
    "axial_m": "on a pad: the same along the axis, with `axial_interval_m`",
    "extent_arc_m": "along the arc, as of contacts, with `extent_arc_interval_m`",
    "extent_axial_m": "on a pad: along the axis, with `extent_axial_interval_m`",
    "resultant_right_N": "sum of the forces as vectors, to the right (growing angles at the "
    "crown), with `resultant_right_interval_N`",
    "resultant_up_N": "likewise towards the crown, with `resultant_up_interval_N`",
    "preferred_by": "how much less -2 log(evidence) is than that of contacts",
}
"""Keys of `field`; those with an interval have a second key for it."""
