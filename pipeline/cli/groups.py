"""Groups of options: a dataclass that a verb takes as one parameter, while each of its fields is an option."""

import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import wraps
from typing import TypeVar

Result = TypeVar("Result")


def grouped(verb: Callable[..., Result]) -> Callable[..., Result]:
    """Return a verb that takes, in place of each parameter whose type is a dataclass, the fields of that class."""
    groups: dict[str, tuple[type, list[str]]] = {}
    flat: list[inspect.Parameter] = []
    signature = inspect.signature(verb)
    for name, parameter in signature.parameters.items():
        group = parameter.annotation
        if not (isinstance(group, type) and is_dataclass(group)):
            flat.append(parameter)
            continue
        fields = list(inspect.signature(group).parameters.values())
        groups[name] = group, [field.name for field in fields]
        flat += [field.replace(kind=inspect.Parameter.KEYWORD_ONLY) for field in fields]
    flat_signature = signature.replace(parameters=flat)

    @wraps(verb)
    def flattened(*args: object, **options: object) -> Result:
        """Call the verb with its groups put together."""
        bound = flat_signature.bind(*args, **options)
        bound.apply_defaults()
        values = dict(bound.arguments)
        for name, (group, fields) in groups.items():
            values[name] = group(**{field: values.pop(field) for field in fields})
        return verb(**values)

    flattened.__signature__ = flat_signature  # type: ignore[attr-defined]  # what typer reads
    return flattened
