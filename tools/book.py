#!/usr/bin/env python3
"""Preprocessor of the book (`mdbook build` runs it, as book.toml says): links that lead from one file of the repository to another lead to its page.

Pages keep the places they have in the repository, those of docs/ at the top. A file that a page links to and docs/SUMMARY.md does not list gets a page at
the end: Markdown, such as records, as it is, scenes and programs as code. Pictures are put into the page. A folder is its README.md; what is left, such
as tables of a megabyte, is named instead of linked. Needs Python alone.
"""

import base64
import json
import os
import re
import sys
from pathlib import Path, PurePosixPath

LARGEST_TEXT_BYTES = 100_000
LARGEST_PICTURE_BYTES = 2_000_000
LANGUAGES = {".toml": "toml", ".py": "python", ".rs": "rust", ".sh": "bash", ".json": "json", ".csv": "", ".tex": "latex", ".obj": "", ".mtl": ""}
PICTURES = {".png": "image/png", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}
# Blocks of code and code in a line, which stay, or a link: whether it is a picture, its text, its target.
CODE_OR_LINK = re.compile(r"```.*?```|`[^`\n]*`|(!?)\[((?:[^\[\]`]|`[^`\n]*`)*)\]\(([^()\s]+)\)", re.DOTALL)


def normal(path):
    return PurePosixPath(os.path.normpath(path).replace(os.sep, "/"))


def place_in_book(file):
    """Path of a file's page; `file` is relative to the repository."""
    inside = file.relative_to("docs") if file.parts[0] == "docs" else file
    if inside.name == "README.md":
        return inside.with_name("index.md")
    return inside if inside.suffix == ".md" else inside.with_name(inside.name + ".md")


class Book:
    def __init__(self, root, source):
        self.root, self.source = Path(root), source
        self.pages = {}  # Of listed files: file → chapter.
        self.added = {}  # Of others, in the order in which they are met.

    def list(self, items):
        for item in items:
            chapter = item.get("Chapter") if isinstance(item, dict) else None
            if chapter is None:
                continue
            if chapter["source_path"] is not None:
                file = normal(f"{self.source}/{chapter['source_path']}")
                chapter["path"] = str(place_in_book(file))
                self.pages[file] = chapter
            self.list(chapter["sub_items"])

    def page(self, file):
        """Whether a file has a page, or can be given one."""
        if file in self.pages or file in self.added:
            return True
        path = self.root / file
        if file.suffix not in {".md", *LANGUAGES} or path.stat().st_size > LARGEST_TEXT_BYTES:
            return False
        text = path.read_text(encoding="utf-8")
        if file.suffix == ".md":
            heading = re.search(r"^# (.+)$", text, re.MULTILINE)
            name = f"{heading.group(1)} ({file.parent.name})" if heading else str(file)
        else:
            name, text = str(file), f"# {file}\n\n```{LANGUAGES[file.suffix]}\n{text}\n```\n"
        place = str(place_in_book(file))
        self.added[file] = {"name": name, "content": text, "number": None, "sub_items": [], "path": place, "source_path": place, "parent_names": []}
        return True

    def linked(self, file, match):
        """What a link of the page of `file` becomes."""
        picture, text, target = match.groups()
        if target is None or target.startswith("#") or "://" in target or target.startswith("mailto:"):
            return match.group(0)
        name, _, anchor = target.partition("#")
        aim = normal(file.parent / name)
        if aim.parts[0] == ".." or not (self.root / aim).exists():
            raise SystemExit(f"{file}: there is no {target}")
        if (self.root / aim / "README.md").is_file():
            aim = aim / "README.md"
        kind = PICTURES.get(aim.suffix)
        if kind and (self.root / aim).stat().st_size <= LARGEST_PICTURE_BYTES:
            data = base64.b64encode((self.root / aim).read_bytes()).decode()
            return f"![{text}](data:{kind};base64,{data})"
        if picture or not (self.root / aim).is_file() or not self.page(aim):
            return f"{text} (`{aim}`)"
        way = os.path.relpath(place_in_book(aim), place_in_book(file).parent).replace(os.sep, "/")
        return f"[{text}]({way}{'#' if anchor else ''}{anchor})"

    def link(self, file, chapter):
        chapter["content"] = CODE_OR_LINK.sub(lambda match: self.linked(file, match), chapter["content"])


def main():
    if sys.argv[1:2] == ["supports"]:
        sys.exit(0 if sys.argv[2:] == ["html"] else 1)
    context, content = json.load(sys.stdin)
    book = Book(context["root"], context["config"]["book"]["src"])
    items = content["items"]
    book.list(items)
    for file, chapter in book.pages.items():
        book.link(file, chapter)
    done = 0
    while done < len(book.added):
        file, chapter = list(book.added.items())[done]
        book.link(file, chapter)
        done += 1
    items.append({"PartTitle": "What pages link to"})
    for name, folder in [("Records", True), ("Files", False)]:
        inside = [{"Chapter": chapter} for file, chapter in sorted(book.added.items()) if (file.parts[0] == "results") is folder]
        items.append({"Chapter": {"name": name, "content": "", "number": None, "sub_items": inside, "path": None, "source_path": None, "parent_names": []}})
    json.dump(content, sys.stdout)


if __name__ == "__main__":
    main()
