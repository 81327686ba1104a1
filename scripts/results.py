#!/usr/bin/env python3
"""Writes docs/results.md from the figures in docs/results/*.json.

    python3 scripts/results.py                                     write docs/results.md
    python3 scripts/results.py --check                             fail if it is not what would be written
    python3 scripts/results.py --bench OUT/results.json FILE.json  put the figures of `gic bench -o OUT` into FILE.json

Needs Python 3.9 and nothing else. Files whose names begin with a digit are shown in their order. Each holds one section:

    {"title": ..., "command": ..., "commit": ..., "machine": ..., "about": [lines], "notes": [lines]}

with `"sources"`: [{"what", "command", "commit", "machine"}] where there are several, and one of

    "columns" and "rows"          shown as they are
    "bodies_of": {TITLE: FILE}    errors of parameters as `--bench` writes them, of several files, a row for each scene
    "laws_of": {TITLE: FILE}      the same by law and parameter, mean and deviation, beside "paper"

The names in `"fitted_on"` are counted apart; `"alone": {TITLE: NAMES}` gives the mean error of some scenes.

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
# What `gic bench` says of a task that waits.
NOT_BEGUN = "has not begun"
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


def error_over_half_width(parameter):
    """Absolute error over half the interval's width, the sharpness of an interval; None where it has no width."""
    low, high = parameter["interval_x100"]
    return 2.0 * abs(parameter["error_x100"]) / (high - low) if high > low else None


def velocity_text(scene):
    return f"{scene['velocity_cm_s']:.2f} ({scene['velocity_inside']} of 3)"


def body_rows(files):
    """A row for each scene: its errors, velocity and volume in each of the files."""
    columns = ["body", "law"]
    for title in files:
        columns += [f"{title}: errors x100 [95 % interval]", "velocity (inside)", "volume"]
    found = {title: {scene["scene"]: scene for scene in file["scenes"]} for title, file in files.items()}
    names = dict.fromkeys(name for scenes in found.values() for name in scenes)
    rows = []
    for name in names:
        laws, cells = set(), []
        for scenes in found.values():
            scene = scenes.get(name)
            if scene is None:
                cells += [""] * 3
                continue
            laws.add(scene["law"])
            errors = "; ".join(map(parameter_text, scene["parameters"]))
            cells += [errors + scene.get("warned", ""), velocity_text(scene), scene.get("volume", "")]
        rows.append([name, " ".join(laws), *cells])
    return columns, rows


def coverage(scenes):
    """How many parameters, determined ones, and components of velocities lie inside their intervals."""
    parameters = [p for scene in scenes for p in scene["parameters"]]
    named = [p for p in parameters if p["identifiable"]]
    return [f"{sum(map(is_inside, parameters))} of {len(parameters)}", f"{sum(map(is_inside, named))} of {len(named)}",
            f"{sum(scene['velocity_inside'] for scene in scenes)} of {3 * len(scenes)}"]


def mean_error(scenes):
    return statistics.fmean(abs(p["error_x100"]) for scene in scenes for p in scene["parameters"])


def summary(title, file, section):
    """Coverage and sharpness of the intervals of a file, failures by name, and what a run takes."""
    scenes, fitted_on = file["scenes"], section.get("fitted_on", [])
    parameters = [p for scene in scenes for p in scene["parameters"]]
    if not parameters:
        return f"{title}: no scene has a result."
    groups = section.get("alone", {}).items()
    alone = "".join(f" ({name} {mean_error([s for s in scenes if s['scene'] in names]):.2f})" for name, names in groups)
    ratios = [ratio for ratio in map(error_over_half_width, parameters) if ratio is not None]
    of_all, of_determined, of_velocities = coverage(scenes)
    text = (
        f"{title[0].upper()}{title[1:]}: {of_all} parameters lie inside, {of_determined} determined "
        f"ones, {of_velocities} components of velocities; mean absolute error {mean_error(scenes):.2f}{alone}, median "
        f"{statistics.median(ratios):.2f} of half-widths{biases(scenes)}."
    )
    if fitted_on:
        unseen = [scene for scene in scenes if scene["scene"] not in fitted_on]
        text += f" Without the {len(scenes) - len(unseen)} that numbers were fitted on: {', '.join(coverage(unseen))}."
    if file.get("failures"):
        text += " Without a result: " + "; ".join(f"{f['scene']} ({f['reason']})" for f in file["failures"]) + "."
    parts = [f"{what} {least:.0f} to {most:.0f} {unit}, median {middle:.0f}"
             for what, unit, (least, middle, most) in file.get("costs", [])]
    return text + (f" A run: {'; '.join(parts)}." if parts else "")


def biases(scenes):
    """Mean signed errors of what may be off in one and the same way in all bodies."""
    def mean(law, name):
        errors = [p["error_x100"] for s in scenes if s["law"] == law for p in s["parameters"] if p["name"] == name]
        return statistics.fmean(errors) if errors else None
    modulus, angle = mean("elastic", "E"), mean("sand", "angle")
    parts = [f"E of elastic bodies {modulus:+.2f}"] if modulus is not None else []
    parts += [f"friction angles {math.degrees(angle / 100.0):+.2f} degrees"] if angle is not None else []
    return f"; signed, {', '.join(parts)}" if parts else ""


def law_rows(files, paper_by_law):
    """The paper's table: mean and deviation by law and parameter, coverage and sharpness, beside the paper."""
    columns = ["law", "parameter"]
    for title in files:
        columns += [f"{title}: mean ± deviation (scenes)", "inside", "error / half-width"]
    rows = []
    for law, paper in paper_by_law.items():
        for name, figure in paper.items():
            cells = []
            for file in files.values():
                cells += law_cells([scene for scene in file["scenes"] if scene["law"] == law], name)
            rows.append([law, name, *cells, str(figure)])
    return [*columns, "paper"], rows


def law_cells(scenes, name):
    """Mean and deviation of the absolute errors of a parameter or of velocities, how many lie inside, sharpness."""
    found = [p for scene in scenes for p in scene["parameters"] if p["name"] == name]
    errors = [abs(p["error_x100"]) for p in found]
    inside, of = sum(map(is_inside, found)), len(found)
    if name == "v":
        errors = [scene["velocity_cm_s"] for scene in scenes]
        inside, of = sum(scene["velocity_inside"] for scene in scenes), 3 * len(scenes)
    ratios = [ratio for ratio in map(error_over_half_width, found) if ratio is not None]
    mean = f"{statistics.fmean(errors):.2f} ± {statistics.pstdev(errors):.2f} ({len(scenes)})" if errors else ""
    return [mean, f"{inside} of {of}", f"{statistics.median(ratios):.2f}" if ratios else ""]


def section_lines(section):
    lines = ["", f"## {section['title']}", ""]
    single = [source_text(section)] if section.get("command") or section.get("machine") else []
    lines += paragraph(" ".join([*section.get("about", []), *single]))
    for source in section.get("sources", []):
        lines += paragraph(f"- {source['what']}: {source_text(source)}", "  ")
    sources = section.get("bodies_of") or section.get("laws_of") or {}
    files = {title: read(FOLDER / name) for title, name in sources.items()}
    if "bodies_of" in section:
        columns, rows = body_rows(files)
    elif "laws_of" in section:
        columns, rows = law_rows(files, section["paper"])
    else:
        columns, rows = section.get("columns"), section.get("rows")
    if columns:
        lines += ["", *table(columns, rows)]
    summaries = [summary(title, file, section) for title, file in files.items()]
    notes = [*summaries, *section.get("notes", [])]
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
    section["scenes"], section["failures"] = [], []
    results = read(bench)
    for scene in results["scenes"]:
        found = scene.get("Ok")
        seed = f"seed {scene['seed']}" if scene.get("seed") is not None else None
        label = ", ".join(filter(None, [scene["scene"], scene.get("case"), seed]))
        if found is None:
            # A suite may be run in batches.
            if scene.get("Err") != NOT_BEGUN:
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
            "volume": f"{100.0 * found['frames'][0]['volume_error']:+.1f} %",
        })
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
