"""Schema checks: the same verdicts as the `jsonschema` package, and messages that name the field."""

from __future__ import annotations

import copy
import json
import random
import re
from pathlib import Path
from typing import Any

import pytest

from LAFlatteningLib.errors import InputFileError, TemplateError
from LAFlatteningLib.schema import load_json, validate

TEMPLATES = Path(__file__).resolve().parents[2] / "LAFlatteningLib" / "templates"

# Every supported keyword, in the kind of document that templates are.
SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "$id": "test",
    "title": "test",
    "type": "object",
    "required": ["kind", "holes"],
    "additionalProperties": False,
    "properties": {
        "kind": {"const": "test/1"},
        "name": {"type": "string", "minLength": 2, "pattern": "^[a-z]+$", "default": "disk"},
        "points": {"type": "integer", "minimum": 3, "maximum": 100},
        "scale": {"type": ["number", "null"], "exclusiveMaximum": 10, "exclusiveMinimum": -10},
        "units": {"enum": ["mm", "cm", 1, None, [1, 2], {"a": 1}]},
        "order": {"type": "array", "items": {"type": "string"}, "minItems": 1, "maxItems": 4, "uniqueItems": True},
        "mixed": {"type": "array", "uniqueItems": True},
        "arc": {"type": "array", "prefixItems": [{"type": "number"}, {"type": "string"}], "items": {"type": "boolean"}},
        "pair": {"type": "array", "prefixItems": [{"type": "number"}, {"type": "number"}], "items": False},
        "closed": {"type": "boolean"},
        "centre": {"anyOf": [{"$ref": "#/$defs/point"}, {"type": "string"}, {"type": "null"}]},
        "tree": {"$ref": "#/$defs/tree"},
        "big": {"oneOf": [{"type": "number", "minimum": 5}, {"type": "integer", "maximum": 9}]},
        "described": {"$ref": "#/$defs/point", "maxItems": 1, "$comment": "what stands beside $ref counts too"},
        "width_mm": {"type": "number", "maximum": 50, "$comment": "the pattern _mm$ below holds as well"},
        "note": {"type": "string", "pattern": "an+"},
        "anything": True,
        "nothing": False,
    },
    "patternProperties": {"^x_": {"type": "number"}, "_mm$": {"type": "number", "minimum": 0}},
    "propertyNames": {"pattern": "^[a-z_]+$"},
    "$defs": {
        "point": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
        "shape": {
            "oneOf": [
                {
                    "type": "object",
                    "required": ["type", "radius"],
                    "additionalProperties": False,
                    "properties": {"type": {"const": "circle"}, "radius": {"type": "number", "exclusiveMinimum": 0}},
                },
                {
                    "type": "object",
                    "required": ["type", "sides"],
                    "properties": {"type": {"const": "box"}, "sides": {"$ref": "#/$defs/point"}},
                },
            ]
        },
        "tree": {
            "type": "object",
            "properties": {"left": {"$ref": "#/$defs/tree"}, "right": {"$ref": "#/$defs/tree"}},
            "additionalProperties": False,
        },
    },
}
SCHEMA["properties"]["holes"] = {"type": "object", "additionalProperties": {"$ref": "#/$defs/shape"}}

DOCUMENT: dict[str, Any] = {
    "kind": "test/1",
    "name": "atrium",
    "points": 20,
    "scale": 1.5,
    "units": "mm",
    "order": ["a", "b"],
    "mixed": [1, True, [1], [True], {"a": 1}, {"a": 1.5}],
    "arc": [1.0, "b", True, False],
    "pair": [1, 2],
    "closed": False,
    "centre": [0, 0.5],
    "tree": {"left": {"right": {}}, "right": {}},
    "big": 12.5,
    "described": None,
    "anything": {"any": ["thing"]},
    "x_mm": 3,
    "width_mm": 40,
    "note": "banana",
    "holes": {"A": {"type": "circle", "radius": 2}, "B": {"type": "box", "sides": [1, 2]}},
}
del DOCUMENT["described"]


def message(document: object, schema: dict[str, Any] = SCHEMA) -> str:
    with pytest.raises(TemplateError) as caught:
        validate(document, schema)
    return str(caught.value)


def changed(**changes: Any) -> dict[str, Any]:
    return {**copy.deepcopy(DOCUMENT), **changes}


# ---- the same verdict as the standard's reference package ----------------------------------------------------


def places(document: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) of a document."""
    keys: list[Any] = []
    if isinstance(document, dict):
        keys = list(document)
    elif isinstance(document, list):
        keys = list(range(len(document)))
    return [(document, key) for key in keys] + [place for key in keys for place in places(document[key])]


def random_value(chance: random.Random, document: Any) -> Any:
    simple = [0, 1, -1, 2, 3, 5, 7, 9, 10, 100, 101, 1.0, 3.0, 2.5, -10, 9.999, 10**30, 1e300, True, False, None]
    texts = ["", "a", "ab", "AB", "mm", "cm", "circle", "box", "test/1", "1", "å∫", "a b\n"]
    nested: list[Any] = [
        [],
        {},
        [1, 2],
        [1.0, 2],
        [True, 2],
        [1, 1.0],
        [0, False],
        ["a", "a"],
        [[1], [True]],
        {"a": 1.0},
    ]
    found = [container[key] for container, key in places(document)]
    return copy.deepcopy(chance.choice(chance.choice([simple, texts, nested, found])))


def mutated(document: Any, names: list[str], chance: random.Random) -> Any:
    document = copy.deepcopy(document)
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        spots = places(document)
        if not spots:
            return random_value(chance, [document])
        container, key = chance.choice(spots)
        action = chance.randrange(4)
        if action == 0:
            container[key] = random_value(chance, document)
        elif action == 1:
            del container[key]
        elif isinstance(container, list):
            container.insert(key, random_value(chance, document) if action == 2 else copy.deepcopy(container[key]))
        elif action == 2:
            container[chance.choice(names)] = random_value(chance, document)
        else:
            container[chance.choice([f"{key}x", key[1:], key.upper(), f"x_{key}"])] = container.pop(key)
    return document


def path_text(steps: Any) -> str:
    text = ""
    for step in steps:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if re.fullmatch(r"[\w-]+", step) else f'["{step}"]'
    return text.removeprefix(".") or "top level"


def all_paths(errors: Any) -> set[str]:
    """Paths of errors, and of the errors inside the alternatives of oneOf and anyOf."""
    found: set[str] = set()
    for error in errors:
        found |= {path_text(error.absolute_path)} | all_paths(error.context)
    return found


def compare(documents: list[Any], schema: dict[str, Any]) -> tuple[int, int]:
    """Assert that both packages agree on every document; how many were valid, and invalid."""
    jsonschema = pytest.importorskip("jsonschema", reason="the reference implementation is not installed")
    reference = jsonschema.Draft202012Validator(schema)
    counts = [0, 0]
    for document in documents:
        errors = list(reference.iter_errors(document))
        counts[bool(errors)] += 1
        if errors:
            text = message(document, schema)
            named = text.split(": ")[0]
            # Where the reference names a list, the message here may name the item of it.
            around = named.rpartition("[")[0] or "top level"
            assert {named, around} & all_paths(errors), (text, document)
        else:
            validate(document, schema)
    return counts[0], counts[1]


def test_same_verdict_on_mutated_documents() -> None:
    chance = random.Random(20240611)
    names = [*SCHEMA["properties"], "x_a", "a_mm", "X", "left", "radius"]
    documents = [DOCUMENT, *(mutated(DOCUMENT, names, chance) for _ in range(4000))]
    valid, invalid = compare(documents, SCHEMA)
    assert valid > 400
    assert invalid > 1500


def test_same_verdict_on_mutated_templates() -> None:
    chance = random.Random(7)
    schema = json.loads((TEMPLATES / "schema.json").read_text(encoding="utf-8"))
    valid = invalid = 0
    for file in sorted(TEMPLATES.glob("*.json")):
        if file.stem == "schema":
            continue
        template = load_json(file)
        validate(template, schema)
        names = ["holes", "shape", "feet", "type", "radius", "centre", "RSPV", "title"]
        counts = compare([mutated(template, names, chance) for _ in range(300)], schema)
        valid, invalid = valid + counts[0], invalid + counts[1]
    assert valid > 50
    assert invalid > 200


@pytest.mark.parametrize("keyword", sorted(SCHEMA["properties"]))
def test_same_verdict_on_single_values(keyword: str) -> None:
    chance = random.Random(keyword)
    schema = {**SCHEMA["properties"], "$defs": SCHEMA["$defs"]}[keyword]
    schema = {"$defs": SCHEMA["$defs"], **schema} if isinstance(schema, dict) else {"allOf": [], "items": schema}
    schema.pop("allOf", None)
    compare([random_value(chance, DOCUMENT) for _ in range(300)], schema)


# ---- messages ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"kind": "x"}, 'kind: expected "test/1", found "x".'),
        ({"name": 5}, "name: expected a text"),
        ({"name": "A"}, 'of the form "^[a-z]+$" and of 2 or more characters, found "A".'),
        ({"points": "20"}, 'points: expected a whole number at least 3 and at most 100, found "20".'),
        ({"points": True}, "points: expected a whole number at least 3 and at most 100, found true."),
        ({"points": 2}, "points: expected a whole number at least 3 and at most 100, found 2."),
        ({"points": 20.5}, "found 20.5."),
        ({"scale": 10}, "scale: expected a number or null greater than -10 and less than 10, found 10."),
        (
            {"units": "cmm"},
            'units: expected one of "mm", "cm", 1, null, a list of 2, an object with "a", found "cmm". Did',
        ),
        ({"order": []}, "order: expected a list of 1 to 4 items, found an empty list."),
        ({"order": ["a", 2]}, "order[1]: expected a text, found 2."),
        ({"order": ["a", "b", "a"]}, 'order[2]: "a" is in the list twice; expected no repetition.'),
        ({"arc": [1, "a", 3]}, "arc[2]: expected true or false, found 3."),
        ({"pair": [1, 2, 3]}, "pair[2]: found 3 where nothing is allowed."),
        ({"nothing": 1}, "nothing: found 1 where nothing is allowed."),
        (
            {"holes": {"RSPV": {"type": "circle", "radius": "big"}}},
            "holes.RSPV.radius: expected a number greater than 0",
        ),
        ({"holes": {"RSPV": {"type": "circle", "radius": 0}}}, "found 0."),
        (
            {"holes": {"RSPV": {"type": "circel", "radius": 1}}},
            'holes.RSPV.type: expected one of "circle", "box", found',
        ),
        ({"holes": {"RSPV": {"type": "circel"}}}, 'Did you mean "circle"?'),
        ({"holes": {"RSPV": {"type": "circle"}}}, 'holes.RSPV: the property "radius" is missing.'),
        ({"holes": {"RSPV": 3}}, "holes.RSPV: expected an object, found 3."),
        ({"holes": {"a vein": {"type": "circle", "radius": -1}}}, 'holes["a vein"].radius: expected a number'),
        (
            {"holes": {"A": {"type": "circle", "raduis": 1}}},
            'holes.A: unknown property "raduis". Did you mean "radius"?',
        ),
        ({"centre": 3}, "centre: expected a list of 2 items or a text or null, found 3."),
        ({"centre": [1, "a"]}, 'centre[1]: expected a number, found "a".'),
        ({"big": 7}, "big: 7 fits 2 of the forms that exclude each other."),
        ({"tree": {"left": {"up": {}}}}, 'tree.left: unknown property "up". Known are "left", "right".'),
        ({"width_mm": -1}, "width_mm: expected a number at least 0, found -1."),
        ({"note": "bbb"}, 'note: expected a text of the form "an+", found "bbb".'),
        ({"x_mm": -1}, "x_mm: expected a number at least 0, found -1."),
        ({"Name": "a"}, 'top level: the name "Name" is not allowed: expected a value of the form "^[a-z_]+$"'),
        ({"hole": {}}, 'top level: unknown property "hole". Did you mean "holes"?'),
        ({"anything": [1, float("nan")]}, "anything[1]: expected a finite number, found NaN."),
        ({"scale": float("-inf")}, "scale: expected a finite number, found -Infinity."),
        ({"anything": {"a": (1, 2)}}, "anything.a: expected a value that JSON can hold, found a Python tuple."),
        ({"anything": {3: 1}}, "anything: expected texts as names, found 3."),
    ],
)
def test_message_names_the_field(change: dict[str, Any], expected: str) -> None:
    assert expected in message(changed(**change))


def test_message_of_missing_property_and_of_the_whole_document() -> None:
    document = changed()
    del document["holes"]
    assert message(document) == 'top level: the property "holes" is missing.'
    assert message([1]) == "top level: expected an object, found a list of 1."


def test_misspelt_name_is_named_before_the_one_that_is_missing() -> None:
    document = changed()
    document["hols"] = document.pop("holes")
    assert message(document) == 'top level: unknown property "hols". Did you mean "holes"?'


def test_long_values_are_cut_in_messages() -> None:
    assert len(message(changed(name=5 * "x" + 500 * "!"))) < 200


@pytest.mark.parametrize(
    ("schema", "expected"),
    [
        ({"minimun": 3}, 'the keyword "minimun" is not supported'),
        ({"properties": {"a": {"multipleOf": 2}}}, '#/properties/a: the keyword "multipleOf"'),
        ({"$defs": {"a": {"if": True}}}, '#/$defs/a: the keyword "if"'),
        ({"anyOf": [{"not": {}}]}, '#/anyOf/0: the keyword "not"'),
        ({"items": {"$ref": "#/$defs/a"}}, 'the reference "#/$defs/a" leads to nothing'),
        ({"$ref": "http://example.org/schema"}, "leads to nothing"),
        ({"$ref": "#/$defs/a", "$defs": {"a": {"$ref": "#/$defs/b"}, "b": {"$ref": "#/$defs/a"}}}, "back to itself"),
        ({"type": "float"}, "unknown type 'float'"),
        ({"patternProperties": {"(": {}}}, "is not a pattern"),
        ({"pattern": "["}, "is not a pattern"),
        ({"items": 3}, "#/items: expected an object or true or false"),
    ],
)
def test_faults_of_the_schema_itself_are_the_developers(schema: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError) as caught:
        validate({}, schema)
    assert not isinstance(caught.value, TemplateError)
    assert expected in str(caught.value)


# ---- load_json -----------------------------------------------------------------------------------------------


def written(folder: Path, content: str | bytes) -> Path:
    file = folder / "template.json"
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


def test_load_json_reads_what_json_reads(tmp_path: Path) -> None:
    content = json.dumps({**DOCUMENT, "ü": "é"}, ensure_ascii=False)
    assert load_json(written(tmp_path, content)) == json.loads(content)
    assert load_json(str(written(tmp_path, b"\xef\xbb\xbf[1, 2.5]"))) == [1, 2.5]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ('{\n  "a": 1,\n  "b" 2\n}', "line 3, column 7"),
        ("", "line 1, column 1"),
        ('{"a": 1} x', "line 1, column 10"),
        ('{"a": {"b": 1, "c": 2, "b": 1}}', 'the property "b" twice'),
        ('{"a": NaN}', "contains NaN"),
        ('{"a": -Infinity}', "contains -Infinity"),
        ('{"a": 1e999}', "contains 1e999"),
        ('{"a": ' + "9" * 5000 + "}", "not JSON that can be read"),
        ("[" * 200000, "not JSON that can be read"),
        (b"\xff\xfe{\x00", "not a text file in UTF-8"),
    ],
)
def test_load_json_says_what_is_wrong(tmp_path: Path, content: str | bytes, expected: str) -> None:
    file = written(tmp_path, content)
    with pytest.raises(InputFileError) as caught:
        load_json(file)
    assert expected in str(caught.value)
    assert str(file) in str(caught.value)


def test_load_json_of_a_missing_file_and_of_a_folder(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="cannot be read: No such file"):
        load_json(tmp_path / "none.json")
    with pytest.raises(InputFileError, match="cannot be read"):
        load_json(tmp_path)


def test_load_json_accepts_nan_where_asked(tmp_path: Path) -> None:
    value = load_json(written(tmp_path, "[NaN, -Infinity, 1e999]"), allow_nan=True)
    assert value[0] != value[0]
    assert value[1:] == [float("-inf"), float("inf")]
