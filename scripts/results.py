#!/usr/bin/env python3
"""Writes docs/results.md from the figures in docs/results/*.json.

    python3 scripts/results.py                                     write docs/results.md
    python3 scripts/results.py --check                             fail if it is not what would be written
    python3 scripts/results.py --bench OUT/results.json FILE.json  put the figures of `gic bench -o OUT` into FILE.json

Needs Python 3.9 and nothing else. Files are shown in the order of their names. Each holds one section:

    {"title": ..., "command": ..., "commit": ..., "machine": ..., "about": [lines], "notes": [lines]}

with `"sources"`: [{"what", "command", "commit", "machine"}] where there are several, and one of

    "columns" and "rows"      shown as they are
    "scenes"                  errors of parameters as `--bench` writes them: a row for each scene, or, with "laws": true
                              (of itself for more than twelve), one for each law and parameter, beside "paper" and
                              "others"; "failures" are named, "costs" told as least, median and most
    "means_of" and "paper"    mean absolute errors by law of the files in {"column title": "FILE.json"}

Errors of parameters are estimate less truth, times 100: log10 of moduli, viscosities and yield stresses, Poisson's
ratio as it is, angles in radians. Velocities are mean absolute errors of the components in cm/s.
"""

import json
import math
import statistics
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "results"
OUTPUT = ROOT / "docs" / "results.md"
WIDTH = 120
# More scenes are told by law.
MOST_SCENE_ROWS = 12
SHORT = {"log10(E)": "E", "log10(mu)": "mu", "log10(kappa)": "kappa", "log10(tau_Y)": "tau_Y", "log10(eta)": "eta",
         "theta_fric": "angle"}


def read(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def table(columns, rows):
    for row in rows:
        if len(row) != len(columns):
            raise SystemExit(f"results: {len(columns)} columns, but a row of {len(row)}: {row}")
    lines = ["| " + " | ".join(str(cell) for cell in line) + " |" for line in [columns, *rows]]
    return [lines[0], "|" + "---|" * len(columns), *lines[1:]]


def paragraph(text, indent=""):
    """Lines of at most 120 characters; code keeps its spaces and may be longer."""
    parts = text.split("`")
    parts[1::2] = [part.replace(" ", "\0") for part in parts[1::2]]
    lines = textwrap.wrap(
        "`".join(parts), WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return [line.replace("\0", " ") for line in lines]


def source_text(source):
    commands = source["command"].split("; ") if source.get("command") else []
    parts = [f"`{command}`" for command in commands]
    return "; ".join(parts + [source[key] for key in ("commit", "machine") if source.get(key)]) + "."


def is_inside(parameter):
    low, high = parameter["interval_x100"]
    return low <= 0.0 <= high


def parameter_text(parameter):
    low, high = parameter["interval_x100"]
    text = f"{parameter['name']} {parameter['error_x100']:+.2f} [{low:.1f}, {high:.1f}]"
    if not parameter["identifiable"]:
        text += ", undetermined"
    return text if is_inside(parameter) else text + ", **outside**"


def scene_rows(section):
    extra = list(dict.fromkeys(key for scene in section["scenes"] for key in scene.get("more", {})))
    columns = ["scene", "law", "errors x100 [95 % interval]", "velocity (inside)", *extra]
    rows = []
    for scene in section["scenes"]:
        errors = "; ".join(map(parameter_text, scene["parameters"]))
        velocity = f"{scene['velocity_cm_s']:.2f}"
        if scene.get("velocity_inside") is not None:
            velocity += f" ({scene['velocity_inside']} of 3)"
        more = scene.get("more", {})
        rows.append([scene["scene"], scene["law"], errors, velocity, *(more.get(key, "") for key in extra)])
    return columns, rows


def scene_summary(section):
    parameters = [p for scene in section["scenes"] for p in scene["parameters"]]
    named = [p for p in parameters if p["identifiable"]]
    velocities = [s["velocity_inside"] for s in section["scenes"] if s.get("velocity_inside") is not None]
    mean = sum(abs(p["error_x100"]) for p in parameters) / len(parameters)
    ratios = [ratio for ratio in map(error_over_half_width, parameters) if ratio is not None]
    if not parameters:
        return "No scene has a result."
    text = f"{sum(map(is_inside, parameters))} of {len(parameters)} parameters lie inside their intervals, "
    text += f"{sum(map(is_inside, named))} of the {len(named)} identifiable ones"
    text += f", {sum(velocities)} of {3 * len(velocities)} components of velocities. " if velocities else ". "
    text += f"Mean absolute error of all parameters: {mean:.2f}."
    if section.get("costs") and ratios:
        text += f" The median error is {statistics.median(ratios):.2f} of half the interval's width."
    return text


def error_over_half_width(parameter):
    """Absolute error over half the interval's width, the sharpness of an interval; None where it has no width."""
    low, high = parameter["interval_x100"]
    return 2.0 * abs(parameter["error_x100"]) / (high - low) if high > low else None


def shows_laws(section):
    return section.get("laws", len(section["scenes"]) > MOST_SCENE_ROWS)


def spread(values):
    """Mean and standard deviation."""
    return f"{statistics.fmean(values):.2f} ± {statistics.pstdev(values):.2f}" if values else "-"


def law_rows(section):
    """The paper's table: mean and deviation by law and parameter, coverage, sharpness, other methods, the paper."""
    others = section.get("others", {})
    columns = ["law (scenes)", "parameter", "gic", "inside", "error / half-width", *others, "paper"]
    rows = []
    for law in dict.fromkeys(scene["law"] for scene in section["scenes"]):
        scenes = [scene for scene in section["scenes"] if scene["law"] == law]
        for name in [*dict.fromkeys(p["name"] for scene in scenes for p in scene["parameters"]), "v"]:
            found = [p for scene in scenes for p in scene["parameters"] if p["name"] == name]
            errors = [abs(p["error_x100"]) for p in found]
            inside, of = sum(map(is_inside, found)), len(found)
            if name == "v":
                errors = [scene["velocity_cm_s"] for scene in scenes]
                inside, of = sum(scene["velocity_inside"] for scene in scenes), 3 * len(scenes)
            ratios = [ratio for ratio in map(error_over_half_width, found) if ratio is not None]
            told = lambda figures: f"{figures[0]:.2f} ± {figures[1]:.2f}" if figures else "-"
            rows.append([
                f"{law} ({len(scenes)})", name, spread(errors), f"{inside} of {of}",
                f"{statistics.median(ratios):.2f}" if ratios else "-",
                *(told(figures.get(law, {}).get(name)) for figures in others.values()),
                told(section.get("paper", {}).get(law, {}).get(name)),
            ])
    return columns, rows


def suite_notes(section):
    """Failures by name, and the distribution of time and memory."""
    notes = []
    if section.get("failures"):
        notes.append("Without a result: " + "; ".join(f"{f['scene']} ({f['reason']})" for f in section["failures"]) + ".")
    parts = [f"{what} {least:.0f} to {most:.0f} {unit}, median {middle:.0f}"
             for what, unit, (least, middle, most) in section.get("costs", [])]
    return notes + ([f"A run: {'; '.join(parts)}."] if parts else [])


def mean_rows(section):
    sources = {title: read(FOLDER / name) for title, name in section["means_of"].items()}
    columns = ["law", "parameters", *(f"{title} (scenes)" for title in sources), "paper"]
    rows = []
    for law, paper in section["paper"].items():
        cells = []
        for source in sources.values():
            scenes = [s for s in source["scenes"] if s["law"] == law]
            of = lambda name: [abs(p["error_x100"]) for s in scenes for p in s["parameters"] if p["name"] == name]
            means = [of(name) if name != "v" else [s["velocity_cm_s"] for s in scenes] for name in paper]
            cells.append(" / ".join(f"{sum(values) / len(values):.2f}" for values in means) + f" ({len(scenes)})")
        rows.append([law, " / ".join(paper), *cells, " / ".join(str(value) for value in paper.values())])
    return columns, rows


def section_lines(section):
    lines = ["", f"## {section['title']}", ""]
    single = [source_text(section)] if section.get("command") or section.get("machine") else []
    lines += paragraph(" ".join([*section.get("about", []), *single]))
    for source in section.get("sources", []):
        lines += paragraph(f"- {source['what']}: {source_text(source)}", "  ")
    lines.append("")
    if "scenes" in section:
        lines += table(*(law_rows(section) if shows_laws(section) else scene_rows(section)))
    elif "means_of" in section:
        lines += table(*mean_rows(section))
    elif "columns" in section:
        lines += table(section["columns"], section["rows"])
    summary = [scene_summary(section), *suite_notes(section)] if "scenes" in section else []
    notes = [*summary, *section.get("notes", [])]
    shown = [*lines, "", *paragraph(" ".join(notes))] if notes else lines
    return shown[:-1] if shown[-1] == "" else shown


def document():
    introduction = read(FOLDER / "introduction.json")
    lines = ["# Measured results", "", *paragraph(" ".join(introduction["about"]))]
    for path in sorted(FOLDER.glob("[0-9]*.json")):
        lines += section_lines(read(path))
    return "\n".join(lines) + "\n"


def unit_error(paper_name, value, truth):
    """Signed error times 100 in the paper's unit."""
    if paper_name.startswith("log10"):
        return 100.0 * math.log10(value / truth)
    if paper_name == "theta_fric":
        return 100.0 * math.radians(value - truth)
    return 100.0 * (value - truth)


def from_bench(bench, path):
    """The figures of a `gic bench` in the section that `path` already holds, or in a new one."""
    section = read(path) if path.exists() else {"title": path.stem, "command": "", "commit": "", "machine": ""}
    section["scenes"], section["failures"] = [], []
    results = read(bench)
    for scene in results["scenes"]:
        found = scene.get("Ok")
        seed = f"seed {scene['seed']}" if scene.get("seed") is not None else None
        label = ", ".join(filter(None, [scene["scene"], scene.get("case"), seed]))
        if found is None:
            section["failures"].append({"scene": label, "reason": scene.get("Err")})
            continue
        parameters = [{
            "name": SHORT.get(p["paper_name"], p["paper_name"]),
            "error_x100": round(unit_error(p["paper_name"], p["estimate"], p["truth"]), 2),
            "interval_x100": [round(unit_error(p["paper_name"], end, p["truth"]), 1) for end in p["interval_95"]],
            "identifiable": p["identifiable"],
        } for p in found["parameters"]]
        velocity = found["velocity"]
        section["scenes"].append({
            "scene": label, "law": found["model"], "parameters": parameters,
            "velocity_cm_s": round(velocity["error_x100"], 2), "velocity_inside": velocity["inside"],
        })
    section["paper"], section["others"] = {}, {}
    for row in results["table"]:
        name = SHORT.get(row["parameter"], row["parameter"])
        if row.get("paper"):
            section["paper"].setdefault(row["model"], {})[name] = row["paper"]
        for method, figures in row.get("others", {}).items():
            rounded = [round(figure, 2) for figure in figures]
            section["others"].setdefault(method, {}).setdefault(row["model"], {})[name] = rounded
    costs = bench.with_name("costs.json")
    section["costs"] = cost_ranges(read(costs)) if costs.exists() else []
    section = {key: value for key, value in section.items() if value != [] and value != {} or key == "scenes"}
    path.write_text(json.dumps(section, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def cost_ranges(costs):
    """What runs take: what, unit, and least, median and most of it."""
    kinds = [("time", "s", "wall_s", 1.0), ("CPU time", "s", "cpu_s", 1.0), ("memory", "MB", "peak_memory_bytes", 1e-6)]
    found = []
    for what, unit, key, scale in kinds:
        values = [scale * cost[key] for cost in costs if cost.get(key) is not None]
        if values:
            found.append([what, unit, [round(v, 1) for v in (min(values), statistics.median(values), max(values))]])
    return found


def main(arguments):
    if arguments[:1] == ["--bench"] and len(arguments) == 3:
        from_bench(Path(arguments[1]), Path(arguments[2]))
    elif arguments == ["--check"]:
        if not OUTPUT.exists() or OUTPUT.read_text(encoding="utf-8") != document():
            raise SystemExit("results: docs/results.md is not what docs/results/*.json say; run scripts/results.py")
    elif not arguments:
        OUTPUT.write_text(document(), encoding="utf-8")
    else:
        raise SystemExit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
