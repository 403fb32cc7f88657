"""Checks JSON documents against a schema: a small part of JSON Schema (draft 2020-12), with messages for people.

The `jsonschema` package does not come with 3D Slicer. The part of the standard that is here gives the same
verdict as that package does; a keyword that is not here is an error of the schema's author (`ValueError`), never
ignored.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from .errors import InputFileError, TemplateError

_ANNOTATIONS = {"$schema", "$id", "$defs", "$comment", "title", "description", "examples", "default"}
_ONE_SCHEMA = {"additionalProperties", "propertyNames", "items"}
_SCHEMA_LIST = {"prefixItems", "oneOf", "anyOf"}
_SCHEMA_TABLE = {"properties", "patternProperties", "$defs"}
_OF_NUMBERS = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")
_OF_TEXTS = ("minLength", "pattern")
_OTHERS = {"$ref", "type", "const", "enum", "required", "minItems", "maxItems", "uniqueItems"}
_KEYWORDS = _ANNOTATIONS.union(_ONE_SCHEMA, _SCHEMA_LIST, _SCHEMA_TABLE, _OF_NUMBERS, _OF_TEXTS, _OTHERS)

_TYPE_NAMES = {
    "object": "an object",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}
_REF = "#/$defs/"

_Path = tuple[str | int, ...]


class _Problem(NamedTuple):
    path: _Path
    message: str
    kind: str
    """The keyword that is broken."""
    choices: Sequence[Any] = ()
    """The values that const or enum allows."""


def validate(document: object, schema: Mapping[str, Any]) -> None:
    """Check a document against a schema.

    Keywords: type, const, enum, required, properties, additionalProperties, patternProperties, propertyNames,
    items, prefixItems, minItems, maxItems, uniqueItems, minimum, exclusiveMinimum, maximum, exclusiveMaximum,
    minLength, pattern, oneOf, anyOf, and $ref to ``#/$defs/NAME``. Annotations (title, description, ...) are ignored.

    Parameters
    ----------
    document : what `load_json` returns: dict, list, str, int, float, bool or None, nested.
    schema : the schema, as a dict.

    Raises
    ------
    TemplateError : the document breaks the schema. The message begins with the path of the field at fault.
    ValueError : the schema itself has an unknown keyword or a reference to nothing.

    Examples
    --------
    >>> validate({"radius": "big"}, {"properties": {"radius": {"type": "number", "exclusiveMinimum": 0}}})
    Traceback (most recent call last):
        ...
    LAFlatteningLib.errors.TemplateError: radius: expected a number greater than 0, found "big".
    """
    definitions = schema.get("$defs", {})
    _check_schema(schema, definitions, "#")
    for problem in _not_json(document, ()):
        raise TemplateError(_sentence(problem))
    for problem in _Checker(definitions).problems(document, schema, ()):
        raise TemplateError(_sentence(problem))


def load_json(path: str | os.PathLike[str], allow_nan: bool = False) -> Any:
    """Read a JSON file (UTF-8, with or without byte order mark).

    Parameters
    ----------
    allow_nan : accept NaN and Infinity, which are not JSON but which 3D Slicer writes in its markups files.

    Raises
    ------
    InputFileError : no such file, not text, not JSON (with line and column), a property twice in one object,
        NaN or an infinite number.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputFileError(f'"{path}" cannot be read: {reason}. Check the name of the file.') from error
    except UnicodeDecodeError as error:
        raise InputFileError(
            f'"{path}" is not a text file in UTF-8, as JSON has to be. Save it again as JSON.'
        ) from error

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(pairs)
        if len(result) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise InputFileError(f'"{path}" has the property "{twice}" twice in one object. Keep one of them.')
        return result

    def constant(name: str) -> float:
        if not allow_nan:
            raise InputFileError(f'"{path}" contains {name}, which is not a number. Replace it by a number.')
        return float(name)

    def finite(digits: str) -> float:
        number = float(digits)
        if math.isinf(number) and not allow_nan:
            raise InputFileError(f'"{path}" contains {digits}, which is too large for a number. Correct it.')
        return number

    try:
        return json.loads(text, object_pairs_hook=unique, parse_constant=constant, parse_float=finite)
    except json.JSONDecodeError as error:
        raise InputFileError(
            f'"{path}" is not valid JSON: line {error.lineno}, column {error.colno}: {error.msg}. '
            "Correct it there, or export the file again."
        ) from error
    except InputFileError:
        raise
    except (ValueError, RecursionError) as error:
        # A whole number of thousands of digits, or lists nested thousands deep.
        raise InputFileError(f'"{path}" is not JSON that can be read: {error}. Export the file again.') from error


class _Checker:
    def __init__(self, definitions: Mapping[str, Any]) -> None:
        self.definitions = definitions

    def problems(self, value: Any, schema: Any, path: _Path) -> Iterator[_Problem]:
        """What is wrong with a value, the most telling first (a misspelt name before the one it leaves missing)."""
        if schema is True:
            return
        if schema is False:
            yield _Problem(path, f"found {_show(value)} where nothing is allowed", "false")
            return
        if "$ref" in schema:
            yield from self.problems(value, self.definitions[schema["$ref"][len(_REF) :]], path)
        yield from self._of_value(value, schema, path)
        if isinstance(value, dict):
            yield from self._of_object(value, schema, path)
        elif isinstance(value, list):
            yield from self._of_list(value, schema, path)
        for keyword in ("anyOf", "oneOf"):
            if keyword in schema:
                yield from self._of_alternatives(value, schema[keyword], keyword, path)

    def _of_value(self, value: Any, schema: Mapping[str, Any], path: _Path) -> Iterator[_Problem]:
        if "type" in schema and not _has_type(value, schema["type"]):
            yield _Problem(path, f"expected {_describe(schema)}, found {_show(value)}", "type")
            return
        for choices in [schema[k] if k == "enum" else [schema[k]] for k in ("const", "enum") if k in schema]:
            if not any(_equal(value, choice) for choice in choices):
                yield _not_a_choice(value, choices, path)
                return
        for keyword in _OF_NUMBERS if _is_number(value) else _OF_TEXTS if isinstance(value, str) else ():
            if keyword in schema and not _FITS[keyword](value, schema[keyword]):
                yield _Problem(path, f"expected {_describe(schema)}, found {_show(value)}", keyword)
                return

    def _of_object(self, value: dict[str, Any], schema: Mapping[str, Any], path: _Path) -> Iterator[_Problem]:
        known = schema.get("properties", {})
        patterns = schema.get("patternProperties", {})
        others = schema.get("additionalProperties", True)
        for name, item in value.items():
            if "propertyNames" in schema:
                for problem in self.problems(name, schema["propertyNames"], path):
                    yield _Problem(path, f'the name "{name}" is not allowed: {problem.message}', "propertyNames")
            rules = [known[name]] if name in known else []
            rules += [rule for pattern, rule in patterns.items() if re.search(pattern, name)]
            if not rules and others is False:
                yield _Problem(path, _unknown_name(name, known, patterns), "additionalProperties")
                continue
            for rule in rules or [others]:
                yield from self.problems(item, rule, (*path, name))
        for name in schema.get("required", ()):
            if name not in value:
                yield _Problem(path, f'the property "{name}" is missing', "required")

    def _of_list(self, value: list[Any], schema: Mapping[str, Any], path: _Path) -> Iterator[_Problem]:
        if len(value) < schema.get("minItems", 0) or len(value) > schema.get("maxItems", math.inf):
            yield _Problem(path, f"expected {_describe(schema)}, found {_show(value)}", "minItems")
        if schema.get("uniqueItems", False):
            for k, item in enumerate(value):
                if any(_equal(item, other) for other in value[:k]):
                    yield _Problem(
                        (*path, k), f"{_show(item)} is in the list twice; expected no repetition", "uniqueItems"
                    )
        first = schema.get("prefixItems", [])
        for k, item in enumerate(value):
            yield from self.problems(item, first[k] if k < len(first) else schema.get("items", True), (*path, k))

    def _of_alternatives(self, value: Any, schemas: Sequence[Any], keyword: str, path: _Path) -> Iterator[_Problem]:
        found = [list(self.problems(value, schema, path)) for schema in schemas]
        fitting = sum(not problems for problems in found)
        if fitting == 1 or (fitting > 1 and keyword == "anyOf"):
            return
        if fitting > 1:
            yield _Problem(path, f"{_show(value)} fits {fitting} of the forms that exclude each other", keyword)
            return
        # Explain the one form that was meant, if that can be told: the only one of the right type, or the only one
        # whose fixed value (a "type": "circle", say) is right.
        meant = [problems for problems in found if not any(p.path == path and p.kind == "type" for p in problems)]
        marks = [next((p for p in problems if p.choices and len(p.path) == len(path) + 1), None) for problems in meant]
        wrong = [mark for mark in marks if mark]
        if len(meant) > 1 and len(wrong) == len(meant) and len({mark.path for mark in wrong}) == 1:
            step = wrong[0].path
            yield _not_a_choice(value[step[-1]], [choice for mark in wrong for choice in mark.choices], step)
            return
        if len(meant) > 1:
            meant = [problems for problems, mark in zip(meant, marks, strict=True) if mark is None]
        if len(meant) == 1:
            yield from meant[0]
            return
        forms = list(dict.fromkeys(_describe(self._resolve(schema)) for schema in schemas))
        if len(forms) > 1 or not meant:
            yield _Problem(path, f"expected {' or '.join(forms)}, found {_show(value)}", keyword)
        else:
            reasons = " ".join(dict.fromkeys(_sentence(problems[0]) for problems in found))
            yield _Problem(path, f"{_show(value)} fits none of the allowed forms ({reasons.rstrip('.')})", keyword)

    def _resolve(self, schema: Any) -> Any:
        while isinstance(schema, dict) and "$ref" in schema:
            schema = self.definitions[schema["$ref"][len(_REF) :]]
        return schema


# ---- the schema itself --------------------------------------------------------------------------------------


def _check_schema(schema: Any, definitions: Mapping[str, Any], where: str) -> None:
    """Raise ValueError for what the author of the schema got wrong, also in parts that no document reaches."""
    if isinstance(schema, bool):
        return
    if not isinstance(schema, Mapping):
        raise ValueError(f"Schema at {where}: expected an object or true or false, found {schema!r}.")
    for keyword, content in schema.items():
        if keyword not in _KEYWORDS:
            raise ValueError(f'Schema at {where}: the keyword "{keyword}" is not supported.')
        if keyword == "$ref":
            _check_reference(content, definitions, where)
        elif keyword == "type":
            names = [content] if isinstance(content, str) else content
            if not set(names) <= set(_TYPE_NAMES):
                raise ValueError(f"Schema at {where}: unknown type {content!r}.")
        elif keyword == "pattern":
            _check_pattern(content, where)
        elif keyword in _ONE_SCHEMA:
            _check_schema(content, definitions, f"{where}/{keyword}")
        elif keyword in _SCHEMA_LIST:
            for k, part in enumerate(content):
                _check_schema(part, definitions, f"{where}/{keyword}/{k}")
        elif keyword in _SCHEMA_TABLE:
            for name, part in content.items():
                if keyword == "patternProperties":
                    _check_pattern(name, where)
                _check_schema(part, definitions, f"{where}/{keyword}/{name}")


def _check_reference(reference: str, definitions: Mapping[str, Any], where: str) -> None:
    seen = [reference]
    while True:
        name = seen[-1].removeprefix(_REF)
        if name == seen[-1] or name not in definitions:
            raise ValueError(f'Schema at {where}: the reference "{seen[-1]}" leads to nothing in "$defs".')
        target = definitions[name]
        if not isinstance(target, Mapping) or "$ref" not in target:
            return
        if target["$ref"] in seen:
            raise ValueError(f'Schema at {where}: the reference "{reference}" leads back to itself.')
        seen.append(target["$ref"])


def _check_pattern(pattern: str, where: str) -> None:
    try:
        re.compile(pattern)
    except re.error as error:
        raise ValueError(f'Schema at {where}: "{pattern}" is not a pattern: {error}.') from error


# ---- values -------------------------------------------------------------------------------------------------


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _has_type(value: Any, names: str | Sequence[str]) -> bool:
    if not isinstance(names, str):
        return any(_has_type(value, name) for name in names)
    if names == "number":
        return _is_number(value)
    if names == "integer":
        # The standard counts 1.0 as an integer.
        return _is_number(value) and (isinstance(value, int) or value.is_integer())
    kind = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}[names]
    return isinstance(value, kind)


def _equal(a: Any, b: Any) -> bool:
    """Equality of JSON values: 1 equals 1.0 but not true, whose Python values are equal."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_equal(a[name], b[name]) for name in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_equal(x, y) for x, y in zip(a, b, strict=True))
    return isinstance(a, bool) == isinstance(b, bool) and a == b


_FITS: dict[str, Callable[[Any, Any], bool]] = {
    "minimum": lambda value, bound: value >= bound,
    "exclusiveMinimum": lambda value, bound: value > bound,
    "maximum": lambda value, bound: value <= bound,
    "exclusiveMaximum": lambda value, bound: value < bound,
    "minLength": lambda value, bound: len(value) >= bound,
    "pattern": lambda value, pattern: re.search(pattern, value) is not None,
}


def _not_json(value: Any, path: _Path) -> Iterator[_Problem]:
    """What no JSON file can hold: NaN, infinite numbers, Python objects."""
    if isinstance(value, dict):
        for name, item in value.items():
            if isinstance(name, str):
                yield from _not_json(item, (*path, name))
            else:
                yield _Problem(path, f"expected texts as names, found {name!r}", "type")
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from _not_json(item, (*path, k))
    elif isinstance(value, float) and not math.isfinite(value):
        yield _Problem(path, f"expected a finite number, found {_show(value)}", "type")
    elif value is not None and not isinstance(value, (str, int, float)):
        yield _Problem(path, f"expected a value that JSON can hold, found a Python {type(value).__name__}", "type")


# ---- messages -----------------------------------------------------------------------------------------------


def _sentence(problem: _Problem) -> str:
    where = ""
    for step in problem.path:
        if isinstance(step, int):
            where += f"[{step}]"
        elif re.fullmatch(r"[\w-]+", step):
            where += f".{step}" if where else step
        else:
            where += f"[{json.dumps(step, ensure_ascii=False)}]"
    ending = "" if problem.message.endswith("?") else "."
    return f"{where or 'top level'}: {problem.message}{ending}"


def _show(value: Any) -> str:
    if isinstance(value, dict):
        names = ", ".join(_quote(list(value)[:3])) or "nothing in it"
        return f"an object with {names}{', ...' if len(value) > 3 else ''}"
    if isinstance(value, list):
        return f"a list of {len(value)}" if value else "an empty list"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _quote(names: Sequence[str]) -> list[str]:
    return [f'"{name}"' for name in names]


def _describe(schema: Any) -> str:
    """What a schema asks for, in words: `a number greater than 0 and at most 1`."""
    if not isinstance(schema, Mapping):
        return "anything" if schema else "nothing"
    if "const" in schema:
        return _show(schema["const"])
    if "enum" in schema:
        choices = [_show(choice) for choice in schema["enum"]]
        return choices[0] if len(choices) == 1 else f"one of {', '.join(choices)}"
    names = schema.get("type", [])
    kinds = [_TYPE_NAMES[name] for name in ([names] if isinstance(names, str) else names)]
    limits = [
        f"{words} {_show(schema[keyword])}"
        for keyword, words in [
            ("exclusiveMinimum", "greater than"),
            ("minimum", "at least"),
            ("exclusiveMaximum", "less than"),
            ("maximum", "at most"),
            ("pattern", "of the form"),
        ]
        if keyword in schema
    ]
    if "minLength" in schema:
        limits.append(f"of {schema['minLength']} or more characters")
    least, most = schema.get("minItems"), schema.get("maxItems")
    if least is not None or most is not None:
        exact = f"of {least} items"
        limits.append(
            exact if least == most else f"of {least or 0} to {'any number of' if most is None else most} items"
        )
    return " ".join(filter(None, [" or ".join(kinds) or "a value", " and ".join(limits)]))


def _not_a_choice(value: Any, choices: Sequence[Any], path: _Path) -> _Problem:
    hint = _did_you_mean(value, choices)
    message = f"expected {_describe({'enum': choices})}, found {_show(value)}{hint}"
    return _Problem(path, message, "enum", choices)


def _did_you_mean(value: Any, choices: Sequence[Any]) -> str:
    texts = [choice for choice in choices if isinstance(choice, str)]
    close = get_close_matches(value, texts, n=1) if isinstance(value, str) else []
    return f'. Did you mean "{close[0]}"?' if close else ""


def _unknown_name(name: str, known: Mapping[str, Any], patterns: Mapping[str, Any]) -> str:
    hint = _did_you_mean(name, list(known))
    if not hint and known:
        hint = f". Known are {', '.join(_quote(list(known)))}"
    elif not hint and patterns:
        hint = f". Expected a name of the form {' or '.join(_quote(list(patterns)))}"
    return f'unknown property "{name}"{hint}'
