#!/usr/bin/env python3
"""Finds the relative links of Markdown pages that lead to no file or to no heading. Needs the standard library only.

tests/docs/links.py FOLDER      all pages below FOLDER, such as /usr/share/doc/carved; the exit code is 1 if a link is dead
"""

import re
import sys
from pathlib import Path

FENCE = re.compile(r"^ *```(\w*)")
SPAN = re.compile(r"(`+)(?!`)(.+?)(?<!`)\1(?!`)", re.S)
LINK = re.compile(r"\]\(([^()\s]+)\)")


def split(page):
    """The blocks of a page as (line, language, text), and its other paragraphs as (line, text)."""
    blocks, paragraphs = [], []
    language, start, held = None, 0, []
    for number, line in enumerate(page.read_text().splitlines(), 1):
        fence = FENCE.match(line)
        if fence and language is None:
            if held:
                paragraphs.append((start, "\n".join(held)))
            language, start, held = fence[1], number + 1, []
        elif fence:
            blocks.append((start, language, "\n".join(held)))
            language, held = None, []
        elif language is None and not line.strip():
            if held:
                paragraphs.append((start, "\n".join(held)))
            held = []
        else:
            start = number if language is None and not held else start
            held.append(line)
    if held:
        paragraphs.append((start, "\n".join(held)))
    return blocks, paragraphs


def headings(page):
    """The anchors that GitHub gives to the headings of a page."""
    anchors, in_block = set(), False
    for line in page.read_text().splitlines():
        in_block ^= bool(FENCE.match(line))
        if not in_block and line.startswith("#"):
            text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", line.lstrip("#").strip())
            anchor = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
            count = 1
            while anchor in anchors:
                anchor, count = f"{anchor.removesuffix(f'-{count - 1}')}-{count}", count + 1
            anchors.add(anchor)
    return anchors


def why_dead(page, link):
    """Why a link of a page leads nowhere, or None. A relative link leads to a file and, where it names one, to a heading."""
    if re.match(r"\w+:", link):
        return None
    path, _, anchor = link.partition("#")
    target = (page.parent / path).resolve() if path else page
    if not target.exists():
        return f"there is no {link}"
    if anchor and target.suffix == ".md" and anchor not in headings(target):
        return f"{link}: the page has no such heading"
    return None


def dead(root, page):
    """The dead links of a page below root, each with its place and the reason."""
    for line, text in split(page)[1]:
        text = SPAN.sub("", text)
        for link in LINK.finditer(text):
            why = why_dead(page, link[1])
            if why is not None:
                yield f"{page.relative_to(root)}:{line + text[: link.start()].count(chr(10))}: {why}"


def main(root):
    """Prints the dead links of all pages below root."""
    pages = sorted(root.rglob("*.md"))
    found = [line for page in pages for line in dead(root, page)]
    if not pages or found:
        sys.exit("\n".join(found) or f"{root} has no pages")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
