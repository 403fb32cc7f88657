"""Sections of a report on how an atrium was prepared and what was read off its map, from the content of their files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .anatomy import LEFT_ATRIUM
from .cavity.plan import USUAL_VALVE_MM
from .fibrosis import ATRIUM, limits_in_words
from .flattening.flat_map import REGION_ARRAY
from .gaps.places import WIDE_MM
from .report import Fixed, Picture, Section, Table

FOUND_BY = {
    "ostium": "cut at its ostium, found by rule",
    "open": "was open already",
    "flat": "cut where the wall is flat",
    "rule": "cut in a plane by rule",
    "given": "cut in the plane that was given",
}
"""How an opening came to be, in words."""


def preparation_section(content: Mapping[str, Any], pictures: list[Picture]) -> Section:
    """How the atrium was cut open, from the content of ``prepare.json``."""
    cavity = content.get("cavity") or {}
    sure = content.get("confidence", "unknown")
    size = f"{_number(cavity.get('area_cm2'), 1)} cm2 of wall and {_number(cavity.get('volume_ml'), 0)} ml"
    named = "by the user" if sure == "given" else f"by rule, with {sure} confidence"
    words = [f"Without veins and appendage beyond their cuts the atrium has {size}. Its openings were named {named}."]
    rows = [
        (
            name,
            FOUND_BY.get(str(plane.get("found_by")), plane.get("found_by")),
            Fixed(plane.get("rim_perimeter_mm") or plane.get("perimeter_mm"), 1),
            "{:.0f} to {:.0f}".format(*USUAL_VALVE_MM) if name == LEFT_ATRIUM.outer else None,
            Fixed(plane.get("kept_mm"), 1),
            ", ".join(f"{x:.0f}" for x in plane.get("centre_mm", ())),
        )
        for name, plane in content.get("planes", {}).items()
    ]
    columns = ("opening", "how", "perimeter (mm)", "usual (mm)", "kept beyond the ostium (mm)", "centre (mm)")
    caption = f"Openings (axes {content.get('space', 'unknown')})"
    warnings = [*map(str, content.get("repairs", ())), *map(str, content.get("notes", ()))]
    if sure == "low":
        warnings.insert(0, "It is not sure which opening is which: look at their names in the picture of the map.")
    return Section("Preparation of the atrium", words, [Table(columns, rows, caption)], pictures, warnings)


def fibrosis_section(content: Mapping[str, Any], pictures: list[Picture]) -> Section:
    """Classes of fibrosis or voltage by region and sub-region, from the content of ``fibrosis.json``."""
    unit = f" {content['unit']}" if content.get("unit") else ""
    labels = _class_labels(content)
    words = [
        f"{content['array']} in classes: {'; '.join(labels)}. Areas are measured on the atrium in 3D"
        + (f", the image sampled every {content['sampled_mm']:.1f} mm." if content.get("sampled_mm") else ".")
    ]
    how = content.get("projection")
    if how:
        low, high = how["interval_mm"]
        value = {"max": "largest", "mean": "mean"}.get(how["statistic"], how["statistic"])
        words.append(
            f"At each place it is the {value} intensity from {low:+.1f} to {high:+.1f} mm along the outward normal of "
            "the wall (negative: inside the chamber)."
        )
    pool = content.get("blood_pool")
    if pool:
        size = f", {pool['volume_ml']:.1f} ml" if pool.get("volume_ml") else ""
        words.append(
            f"The thresholds come from the rule {content['rule']} and the blood pool: mean {pool['mean']:.4g}, SD "
            f"{pool['sd']:.3g} ({pool['how']}{size})."
        )
    parts = content["parts"]
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for part in parts:
        groups.setdefault("" if part["group"] in (ATRIUM, REGION_ARRAY) else part["group"], []).append(part)
    missing = any(part["missing_cm2"] > 0.0 for part in parts)
    columns = ["part", "area (cm2)", f"mean{f' ({unit.strip()})' if unit else ''}"]
    columns += [f"{name} (%)" for name in content["classes"]] + (["no value (cm2)"] if missing else [])
    tables = [
        Table(columns, [_part_row(part, missing) for part in found], f"Sub-regions: {group}" if group else "By region")
        for group, found in groups.items()
    ]
    # High values of what has a unit (activation times) are no fibrosis.
    above = content["array"] if content.get("unit") else "Fibrosis"
    title = above if content["direction"] == "above" else "Low voltage"
    return Section(title, words, tables, pictures, list(content.get("notes", [])))


def comparison_section(content: Mapping[str, Any], pictures: list[Picture]) -> Section:
    """Two maps compared, from the content of ``comparison.json``."""
    same = content["scale"] == "values"
    words = [
        f"A is {content['array_a']} of {content['a']}, B is {content['array_b']} of {content['b']}, both on the "
        f"template {content['template']}. Every place counts by its area on the atria. "
        + (
            "The difference is B - A in the unit of the array."
            if same
            else "They are different quantities: the difference is B - A of their percentiles, from normal to diseased."
        )
    ]
    overlap = content.get("threshold_a") is not None
    columns = ["part", "area (cm2)", "Pearson r", "Spearman rho", "mean A", "mean B"]
    columns += ["B - A" if same else "B - A (percentiles)", "SD of B - A", *(["Dice"] if overlap else [])]
    columns.append("left out (%)")
    rows = [
        (
            _part_name(part["region"], part["name"]),
            Fixed(part["area_cm2"], 1),
            Fixed(part["pearson"], 3),
            Fixed(part["spearman"], 3),
            part["mean_a"],
            part["mean_b"],
            part["difference"],
            part["difference_sd"],
            *([Fixed(part["dice"], 3)] if overlap else []),
            Fixed(part["missing_percent"], 1),
        )
        for part in content["parts"]
    ]
    tables = [Table(columns, rows, "Agreement by region")]
    return Section("Comparison", words, tables, pictures, list(content.get("notes", [])))


def summary_section(found: Mapping[str, Mapping[str, Any]]) -> Section | None:
    """What was read off the map in a few lines; None where nothing was.

    Parameters
    ----------
    found : "fibrosis", "gaps", "comparison" -> content of the file, for those that are there.
    """
    rows: list[tuple[str, str]] = []
    if "fibrosis" in found:
        content = found["fibrosis"]
        whole, *rest = content["parts"]
        first = _class_labels(content)[1:]
        shares = ", ".join(
            f"{label}: {_number(share, 1)} %, {area:.1f} cm2"
            for label, share, area in zip(first, whole["class_percent"][1:], whole["class_cm2"][1:], strict=True)
        )
        rows.append((f"{content['array']}, whole atrium ({whole['area_cm2']:.0f} cm2)", shares))
        regions = [part for part in rest if part["group"] == REGION_ARRAY and part["beyond_percent"] is not None]
        if regions:
            most = max(regions, key=lambda part: part["beyond_percent"])
            name = _part_name(most["label"], most["name"])
            rows.append(("most affected region", f"{name}: {most['beyond_percent']:.1f} % beyond the first threshold"))
    if "gaps" in found:
        results = found["gaps"]["results"]
        shown = results[len(results) // 2]
        rings = [f"{name} {_ring_words(ring)}" for name, ring in shown["areas"].items()]
        rings += [f"{name} not measured" for name in found["gaps"].get("left_out", ())]
        rows.append(("rings of scar round the veins (length open, number of gaps)", "; ".join(rings)))
    if "comparison" in found:
        content = found["comparison"]
        whole = content["parts"][0]
        words = f"Pearson r {_number(whole['pearson'], 2)}, Spearman rho {_number(whole['spearman'], 2)}"
        if whole["dice"] is not None:
            words += f", Dice {whole['dice']:.2f}"
        rows.append((f"agreement with {content['b']}", words))
    return Section("Summary", (), [Table(("", "found"), rows)]) if rows else None


def _ring_words(ring: Mapping[str, Any]) -> str:
    if ring["complete"]:
        return "complete"
    words = f"{ring['gap_length_mm']:.1f} mm open in {ring['gap_count'] + ring['small_gaps']}"
    return f"{words} ({ring['wide_gaps']} of {WIDE_MM:g} mm or more)" if "wide_gaps" in ring else words


def _class_labels(content: Mapping[str, Any]) -> list[str]:
    """The classes of ``fibrosis.json`` with their limits, from normal on."""
    limits = limits_in_words(content["thresholds"], content["direction"], content.get("unit", ""))
    return [f"{name} ({text})" for name, text in zip(content["classes"], limits, strict=True)]


def _part_row(part: Mapping[str, Any], missing: bool) -> tuple[Any, ...]:
    shares: Sequence[Any] = part["class_percent"]
    name = part["name"] if part["group"] == ATRIUM else _part_name(part["label"], part["name"], part["group"])
    row = (name, Fixed(part["area_cm2"], 1), part["mean"], *(Fixed(share, 1) for share in shares))
    return (*row, Fixed(part["missing_cm2"], 1)) if missing else row


def _part_name(label: int, name: str, group: str = REGION_ARRAY) -> str:
    """A region or sub-region with its number; the whole has none."""
    if group == REGION_ARRAY:
        return f"R{label} {name}" if label else name
    return f"{label} {name}"


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
