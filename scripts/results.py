#!/usr/bin/env python3
"""Writes docs/results.md from the figures in docs/results/*.json.

    python3 scripts/results.py                                     write docs/results.md
    python3 scripts/results.py --check                             fail if it is not what would be written
    python3 scripts/results.py --bench OUT/results.json FILE.json  put the figures of `gic bench -o OUT` into FILE.json

Needs Python 3.9 and nothing else. Files are shown in the order of their names. Each holds one section:

    {"title": ..., "command": ..., "commit": ..., "machine": ..., "about": [lines], "notes": [lines]}

with `"sources"`: [{"what", "command", "commit", "machine"}] where there are several, and one of

    "columns" and "rows"      shown as they are
    "scenes"                  errors of parameters as `--bench` writes them
    "means_of" and "paper"    mean absolute errors by law of the files in {"column title": "FILE.json"}

Errors of parameters are estimate less truth, times 100: log10 of moduli, viscosities and yield stresses, Poisson's
ratio as it is, angles in radians. Velocities are mean absolute errors of the components in cm/s.
"""

import json
import math
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "results"
OUTPUT = ROOT / "docs" / "results.md"
WIDTH = 120
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
    text = f"{sum(map(is_inside, parameters))} of {len(parameters)} parameters lie inside their intervals, "
    text += f"{sum(map(is_inside, named))} of the {len(named)} identifiable ones"
    text += f", {sum(velocities)} of {3 * len(velocities)} components of velocities. " if velocities else ". "
    return text + f"Mean absolute error of all parameters: {mean:.2f}."


def mean_rows(section):
    sources = {title: read(FOLDER / name) for title, name in section["means_of"].items()}
    columns = ["law (scenes)", "parameters", *sources, "paper"]
    rows = []
    for law, paper in section["paper"].items():
        cells, count = [], 0
        for source in sources.values():
            scenes = [s for s in source["scenes"] if s["law"] == law]
            count = len(scenes)
            of = lambda name: [abs(p["error_x100"]) for s in scenes for p in s["parameters"] if p["name"] == name]
            means = [of(name) if name != "v" else [s["velocity_cm_s"] for s in scenes] for name in paper]
            cells.append(" / ".join(f"{sum(values) / len(values):.2f}" for values in means))
        rows.append([f"{law} ({count})", " / ".join(paper), *cells, " / ".join(str(value) for value in paper.values())])
    return columns, rows


def section_lines(section):
    lines = ["", f"## {section['title']}", ""]
    single = [source_text(section)] if section.get("command") or section.get("machine") else []
    lines += paragraph(" ".join([*section.get("about", []), *single]))
    for source in section.get("sources", []):
        lines += paragraph(f"- {source['what']}: {source_text(source)}", "  ")
    lines.append("")
    if "scenes" in section:
        lines += table(*scene_rows(section))
    elif "means_of" in section:
        lines += table(*mean_rows(section))
    elif "columns" in section:
        lines += table(section["columns"], section["rows"])
    notes = [*([scene_summary(section)] if "scenes" in section else []), *section.get("notes", [])]
    return [*lines, "", *paragraph(" ".join(notes))] if notes else lines


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
    section["scenes"] = []
    for scene in read(bench)["scenes"]:
        found = scene.get("Ok")
        if found is None:
            raise SystemExit(f"results: {scene['scene']} has no figures: {scene.get('Err')}")
        parameters = [{
            "name": SHORT.get(p["paper_name"], p["paper_name"]),
            "error_x100": round(unit_error(p["paper_name"], p["estimate"], p["truth"]), 2),
            "interval_x100": [round(unit_error(p["paper_name"], end, p["truth"]), 1) for end in p["interval_95"]],
            "identifiable": p["identifiable"],
        } for p in found["parameters"]]
        velocity = found["velocity"]
        section["scenes"].append({
            "scene": scene["scene"], "law": found["model"], "parameters": parameters,
            "velocity_cm_s": round(velocity["error_x100"], 2), "velocity_inside": velocity["inside"],
        })
    path.write_text(json.dumps(section, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


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
