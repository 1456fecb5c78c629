"""The continuous inputs of a scene: what a result can be differentiated with respect to."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from suas_jax.config.consistency import contradictions
from suas_jax.config.errors import ConfigError, Mistake, nearest, show
from suas_jax.config.fields import Spec
from suas_jax.config.schema_scene import SceneSpec
from suas_jax.config.schema_solve import SolveSpec
from suas_jax.config.validation import validate_table

Leaf = str | int | float | None

# How exactly to compute, and where tables have their values: constants of every derivative.
_DISCRETE = (
    "solve.rtol",
    *(f"geometry.{of}.{way}." for of in ("thickness", "oil_gap") for way in ("arc", "axial")),
)
# Says where numbers come from; the model doesn't read it.
_RECORDS = frozenset({"calibration", "correlation", "note"})


def continuous_inputs(scene: Spec) -> dict[str, float]:
    """Every continuous input that is present in a scene, its skin and preset filled in.

    Returns:
        SI values (angles in radians) by TOML path with indices, such as ``material.C1``,
        ``material.mu.1``, ``load.0.force``. What the files don't give is not listed, so that
        defaults stay constants.
    """
    return {path: float(value) for path, value in given_inputs(scene).items()}


def given_inputs(scene: Spec) -> dict[str, float]:
    """The same, an `UncertainQuantity` where the files state a standard deviation."""
    return {
        path: value
        for path, value, given in _leaves(scene)
        if given and isinstance(value, float) and not path.startswith(_DISCRETE)
    }


def structure(scene: Spec) -> tuple[tuple[str, Leaf], ...]:
    """All of a scene but its continuous inputs, as pairs of TOML path and value.

    They are choices, counts, and defaults that the files don't give. Hashable, and equal for
    scenes that differ in continuous inputs only.
    """
    inputs = continuous_inputs(scene)
    return tuple((path, value) for path, value, _ in _leaves(scene) if path not in inputs)


def with_inputs(scene: SceneSpec, values: Mapping[str, float]) -> SceneSpec:
    """Change continuous inputs of a scene; the result is checked like any other.

    Args:
        scene: the scene.
        values: new SI values by path, as `continuous_inputs` lists them.

    Raises:
        ValueError: a path is not a continuous input of the scene, or a value is not allowed.
    """
    check_inputs(values, continuous_inputs(scene), "scene")
    changed: SceneSpec = _replaced(scene, {tuple(p.split(".")): v for p, v in values.items()})
    return changed


def check_inputs(paths: Iterable[str], known: Collection[str], whose: str) -> None:
    """Refuse (ValueError) paths that are not among the inputs of a scene or a skin."""
    for path in paths:
        if path not in known:
            near = nearest(path, known)
            hint = f'; did you mean "{near}"?' if near else ""
            raise ValueError(f'"{path}" is not a continuous input of this {whose}{hint}')


def with_solve(scene: SceneSpec, *, source: str = "command line", **changes: Any) -> SceneSpec:
    """Change keys of a scene's [solve] table, as an option of a command does.

    Args:
        scene: the scene.
        source: what messages call the origin of the changes.
        **changes: new values by key; None takes the key out.

    Raises:
        ConfigError: a value is not allowed, or doesn't fit the other keys.
    """
    given = {key: getattr(scene.solve, key) for key in scene.solve.model_fields_set}
    wanted = {key: value for key, value in {**given, **changes}.items() if value is not None}
    solve, findings = validate_table(SolveSpec, wanted, "solve", units_required=False)
    mistakes = [Mistake(source, key, advice, value) for key, advice, value in findings]
    if mistakes:
        raise ConfigError(mistakes)
    fields = {**_given(scene), "solve": solve}
    # Only what concerns [solve] can be wrong now; the rest of the scene was right before.
    concerned = ("geometry", "oil", "loads", "solve")
    unfit = contradictions({name: fields.get(name) for name in concerned})
    if unfit:
        shown = {f"solve.{key}": show(value) for key, value in wanted.items()}
        raise ConfigError(Mistake(source, key, text, shown.get(key)) for key, text in unfit)
    return SceneSpec(**fields)


def _leaves(scene: Spec) -> Iterator[tuple[str, Leaf, bool]]:
    """Walk over path, value and presence of everything in a scene."""

    def walk(path: str, value: Any, given: bool) -> Iterator[tuple[str, Leaf, bool]]:
        prefix = f"{path}." if path else ""
        if isinstance(value, Spec):
            for name, field in type(value).model_fields.items():
                if name in _RECORDS:
                    continue
                present = given and name in value.model_fields_set
                yield from walk(prefix + (field.alias or name), getattr(value, name), present)
        elif isinstance(value, tuple):
            for index, entry in enumerate(value):
                yield from walk(f"{prefix}{index}", entry, given)
        else:
            yield path, value, given

    yield from walk("", scene, True)


def _given(specification: Spec) -> dict[str, Any]:
    fields = type(specification).model_fields
    return {k: getattr(specification, k) for k in fields if k in specification.model_fields_set}


def _replaced(value: Any, changes: Mapping[tuple[str, ...], float]) -> Any:
    """Rebuild a specification, tuple or value with changes by path."""
    if () in changes:
        return changes[()]
    by_head: dict[str, dict[tuple[str, ...], float]] = {}
    for (head, *rest), change in changes.items():
        by_head.setdefault(head, {})[tuple(rest)] = change
    if isinstance(value, tuple):
        return tuple(
            _replaced(entry, by_head[str(index)]) if str(index) in by_head else entry
            for index, entry in enumerate(value)
        )
    fields = _given(value)
    for name, field in type(value).model_fields.items():
        inside = by_head.get(field.alias or name)
        if inside:
            fields[name] = _replaced(fields[name], inside)
    return type(value)(**fields)
