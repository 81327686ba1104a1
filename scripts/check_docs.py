#!/usr/bin/env python3
"""Checks the documents: lengths of lines and files, words of a diary, links, names of files and types.

    python3 scripts/check_docs.py              all tracked Markdown files
    python3 scripts/check_docs.py --comments   lengths of lines in comments of the Rust sources, too

Prints one line per problem and exits with 1 if there is any. Needs Python 3.9, git, and nothing else.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WIDTH = 120
# File, or folder of files: most lines.
MOST_LINES = {"README.md": 120, "ARCHITECTURE.md": 150, "docs/results.md": 200, "CODE_STYLE.md": 100}
MOST_LINES_OF_DECISION = 15
# Documents say what is; git says what was. Dates belong into these files only.
DATED = {"CHANGELOG.md", "docs/results.md"}
DATE = r"\b20\d\d-\d\d-\d\d\b"
DIARY = [
    r"\bsessions?\b",
    r"\bsittings?\b",
    r"\b(?:was|were|been) tried\b",
    r"\btried (?:then|too|again)\b",
    r"\btaken back\b",
    r"\bat first\b(?!,? sight)",
    r"\bused to\b",
    r"\b(?:today|yesterday|tomorrow)\b",
    r"\b(?:last|this|next) (?:week|month|night)\b",
    r"\b(?:formerly|previously|recently|lately|until now)\b",
    r"\bas before\b",
    r"(?:^|[.;:(] )[Bb]efore[,:]",
    r"\bbefore[,:)] ",
    r"\bearlier version\b",
    r"\bold (?:code|version)\b",
]


def tracked(pattern):
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", pattern]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [name for name in names.split("\n") if name and (ROOT / name).is_file()]


def prose(text):
    """Numbered lines outside code blocks."""
    inside = False
    for number, line in enumerate(text.split("\n"), 1):
        if line.lstrip().startswith("```"):
            inside = not inside
        elif not inside:
            yield number, line


def bare(line):
    """A line without its code and the addresses of its links."""
    return re.sub(r"\]\([^)]*\)", "]", re.sub(r"`[^`]*`", "", line))


def anchors(path):
    headings = [line.lstrip("#").strip() for _, line in prose(path.read_text(encoding="utf-8")) if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def link_problems(name, line):
    for target in re.findall(r"\]\(([^)\s]+)\)", line):
        if re.match(r"\w+:", target):
            continue
        file, _, anchor = target.partition("#")
        path = (ROOT / name).parent / file if file else ROOT / name
        if not path.exists():
            yield f"links to {target}, which does not exist"
        elif anchor and anchor not in anchors(path):
            yield f"links to {target}, which has no such heading"
    for path in re.findall(r"`((?:crates|docs|scripts|examples)/[\w./*-]+)`", line):
        if not any(ROOT.glob(path.rstrip("/"))):
            yield f"names {path}, which does not exist"


def name_problems(line, sources):
    for path in re.findall(r"`[^`]*?\b([A-Z]\w+::\w+)[^`]*`", line):
        if not all(re.search(rf"\b{word}\b", sources) for word in path.split("::")):
            yield f"names {path}, which is not in the sources"


def document_problems(name, sources):
    text = (ROOT / name).read_text(encoding="utf-8")
    for number, line in prose(text):
        is_table = line.lstrip().startswith("|")
        if not is_table and len(bare(line)) > WIDTH:
            yield number, f"is {len(line)} characters long"
        words = DIARY + ([] if name in DATED else [DATE])
        for word in words:
            found = re.search(word, bare(line))
            if found:
                yield number, f"reads like a diary: {found.group(0)!r}"
        for problem in [*link_problems(name, line), *name_problems(line, sources)]:
            yield number, problem
    lines = text.count("\n")
    is_decision = re.fullmatch(r"docs/decisions/\d{4}-[\w-]+\.md", name)
    most = MOST_LINES_OF_DECISION if is_decision else MOST_LINES.get(name)
    if most and lines > most:
        yield lines, f"has {lines} lines, at most {most} are allowed"
    if is_decision and f"({Path(name).name})" not in (ROOT / "docs/decisions/README.md").read_text(encoding="utf-8"):
        yield 1, "is missing in docs/decisions/README.md"


def comment_problems(name):
    for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").split("\n"), 1):
        is_comment = line.lstrip().startswith("//")
        is_table = line.lstrip("/! ").startswith("|")
        if is_comment and not is_table and len(line) > WIDTH and "://" not in line:
            yield number, f"is a comment of {len(line)} characters"


def main():
    sources = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in tracked("*.rs"))
    problems = [(name, *problem) for name in tracked("*.md") for problem in document_problems(name, sources)]
    if "--comments" in sys.argv[1:]:
        problems += [(name, *problem) for name in tracked("*.rs") for problem in comment_problems(name)]
    for name, number, problem in problems:
        print(f"{name}:{number}: {problem}")
    if problems:
        sys.exit(f"check_docs: {len(problems)} problems")


if __name__ == "__main__":
    main()
